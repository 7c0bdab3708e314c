//! Access to the figures of a summary.

use serde_json::Value;

/// Names of the axes.
pub(crate) const AXES: [&str; 3] = ["x", "y", "z"];
/// Length of a tick [s].
pub(crate) const TICK_S: f64 = 1e-3;

/// Value of an axis in an array of the three axes; `None` if the run measured none.
pub(crate) fn axis_figure(summary: &Value, path: &str, axis: usize) -> Option<f64> {
    summary.pointer(path)?.get(axis)?.as_f64()
}

/// Largest value of the three axes.
pub(crate) fn largest(summary: &Value, path: &str) -> Option<f64> {
    (0..AXES.len()).filter_map(|axis| axis_figure(summary, path, axis)).reduce(f64::max)
}

/// Sum of the three axes.
pub(crate) fn sum(summary: &Value, path: &str) -> f64 {
    (0..AXES.len()).filter_map(|axis| axis_figure(summary, path, axis)).sum()
}

/// Single number.
pub(crate) fn number(summary: &Value, path: &str) -> Option<f64> {
    summary.pointer(path)?.as_f64()
}

/// Elements of a list; none if there is no list.
pub(crate) fn list<'a>(summary: &'a Value, path: &str) -> &'a [Value] {
    summary.pointer(path).and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default()
}

/// Formats a value with a number of decimals; a dash for `None`.
pub(crate) fn digits(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.digits$}"))
}
