//! Metrics as rows, generic over their structure: new metrics of the log crate need no change here.

use crate::run::RunInfo;
use serde_json::Value;
use std::fmt::Write;

/// Most elements of a list in a table.
const MAX_ELEMENTS: usize = 32;

/// Row of the table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct MetricRow {
    /// Name of the metric, without its section.
    pub(crate) name: String,
    /// A value, or the values of a list, such as the axes x, y and z.
    pub(crate) cells: Vec<String>,
}

/// Splits the metrics into sections of rows. Metrics without data are left out.
pub(crate) fn sections(metrics: &Value) -> Vec<(String, Vec<MetricRow>)> {
    let Value::Object(sections) = metrics else { return Vec::new() };
    let rows = |value: &Value| {
        let mut rows = Vec::new();
        flatten(String::new(), value, &mut rows);
        rows
    };
    sections.iter().map(|(name, value)| (words(name), rows(value))).filter(|(_, rows)| !rows.is_empty()).collect()
}

fn flatten(name: String, value: &Value, rows: &mut Vec<MetricRow>) {
    let inner = |key: &str| if name.is_empty() { words(key) } else { format!("{name}, {}", words(key)) };
    match value {
        Value::Object(fields) => {
            for (key, value) in fields {
                flatten(inner(key), value, rows);
            }
        }
        Value::Array(list) if list.iter().any(|value| value.is_object() || value.is_array()) => {
            for (i, value) in list.iter().enumerate().take(MAX_ELEMENTS) {
                flatten(inner(&i.to_string()), value, rows);
            }
        }
        Value::Array(list) if list.iter().all(Value::is_null) => {}
        Value::Array(list) => rows.push(MetricRow { name, cells: list.iter().take(MAX_ELEMENTS).map(cell).collect() }),
        Value::Null => {}
        value => rows.push(MetricRow { name, cells: vec![cell(value)] }),
    }
}

/// Converts the name of a field to words, with its unit in brackets.
fn words(key: &str) -> String {
    const UNITS: [(&str, &str); 8] =
        [("m", "m"), ("n", "N"), ("us", "us"), ("ms", "ms"), ("j", "J"), ("s", "s"), ("deg", "degrees"), ("percent", "%")];
    let unit = key.rsplit_once('_').and_then(|(name, end)| Some((name, UNITS.iter().find(|(short, _)| *short == end)?.1)));
    match unit {
        Some((name, unit)) => format!("{} ({unit})", name.replace('_', " ")),
        None => key.replace('_', " "),
    }
}

fn cell(value: &Value) -> String {
    match value {
        Value::Null => "-".to_owned(),
        Value::Bool(true) => "yes".to_owned(),
        Value::Bool(false) => "no".to_owned(),
        Value::String(text) => text.clone(),
        Value::Number(number) => match (number.as_i64(), number.as_f64()) {
            (None, Some(value)) => float(value),
            _ => number.to_string(),
        },
        other => other.to_string(),
    }
}

/// Formats a number to four digits.
fn float(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 {
        "0".to_owned()
    } else if !(1e-4..1e6).contains(&size) {
        format!("{value:.3e}")
    } else {
        let digits = (3.0 - size.log10().floor()).clamp(0.0, 8.0) as usize;
        format!("{value:.digits$}")
    }
}

/// Formats run and metrics for the terminal.
pub(crate) fn text(run: &RunInfo, metrics: &Value, events: u64) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write(&mut out, run, metrics, events);
    out
}

fn write(out: &mut String, run: &RunInfo, metrics: &Value, events: u64) -> std::fmt::Result {
    let or = |text: &str, other: &str| if text.is_empty() { other.to_owned() } else { text.to_owned() };
    writeln!(
        out,
        "{} ({}): {}, {:.3} s, {} messages, {events} events",
        or(&run.scenario, "unnamed run"),
        or(&run.clock, "clock unknown"),
        run.ending(),
        run.duration_s,
        run.messages
    )?;
    if let Some(cause) = &run.cut_off {
        writeln!(out, "  CUT OFF: {cause}")?;
    }
    for (section, rows) in sections(metrics) {
        writeln!(out, "  {section}")?;
        for row in rows {
            write!(out, "    {:<36}", row.name)?;
            for cell in &row.cells {
                write!(out, " {cell:>12}")?;
            }
            writeln!(out)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn sections_any_metrics_become_rows() {
        let metrics = json!({
            "force": { "rms_n": [0.123_456, null, 1234.6], "desired_n": [null, null, null], "ok": true },
            "timing": { "latency_us": { "p50": 55.0, "max": 1e9 }, "late_ticks": 3 },
            "moments": { "objects": [{ "name": "box", "rotated_deg": 90.0 }] },
            "empty": {},
        });
        let found: Vec<_> = sections(&metrics)
            .into_iter()
            .flat_map(|(section, rows)| {
                rows.into_iter().map(move |row| format!("{section}/{}: {}", row.name, row.cells.join(" ")))
            })
            .collect();
        for row in [
            "force/rms (N): 0.1235 - 1235",
            "force/ok: yes",
            "timing/latency (us), p50: 55.00",
            "timing/latency (us), max: 1.000e9",
            "timing/late ticks: 3",
            "moments/objects, 0, name: box",
            "moments/objects, 0, rotated (degrees): 90.00",
        ] {
            assert!(found.iter().any(|other| other == row), "{row} is not in {found:#?}");
        }
        assert_eq!(found.len(), 7);
    }
}
