//! Figures out of a summary.

use serde_json::Value;

/// Names of the axes.
pub(crate) const AXES: [&str; 3] = ["x", "y", "z"];
/// A tick, s.
pub(crate) const TICK_S: f64 = 1e-3;

/// An element of an array of the three axes; `None` where there was nothing to measure.
pub(crate) fn on(summary: &Value, path: &str, axis: usize) -> Option<f64> {
    summary.pointer(path)?.get(axis)?.as_f64()
}

/// The largest of the three axes.
pub(crate) fn largest(summary: &Value, path: &str) -> Option<f64> {
    (0..AXES.len()).filter_map(|axis| on(summary, path, axis)).reduce(f64::max)
}

/// The sum of the three axes.
pub(crate) fn sum(summary: &Value, path: &str) -> f64 {
    (0..AXES.len()).filter_map(|axis| on(summary, path, axis)).sum()
}

/// A single number.
pub(crate) fn number(summary: &Value, path: &str) -> Option<f64> {
    summary.pointer(path)?.as_f64()
}

/// The elements of a list; none if there is no list.
pub(crate) fn list<'a>(summary: &'a Value, path: &str) -> &'a [Value] {
    summary.pointer(path).and_then(Value::as_array).map(Vec::as_slice).unwrap_or_default()
}

/// With so many digits after the point, or a dash.
pub(crate) fn digits(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.digits$}"))
}
