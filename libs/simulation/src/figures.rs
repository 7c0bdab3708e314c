//! Named figures of a simulation: the columns of the CSV file and the fields of the JSON.

use crate::study::{Done, End};
use serde_json::{Map, Value, json};

const AXES: [&str; 3] = ["x", "y", "z"];

/// All figures in the order of the columns; null without a measurement.
#[must_use]
pub fn figures(done: &Done) -> Vec<(String, Value)> {
    let mut list = FigureList(Vec::new());
    list.push("completed", json!(done.end == End::Completed));
    list.push("error", if let End::Failed(error) = &done.end { json!(error) } else { Value::Null });
    list.push("simulated_s", json!(done.simulated_s()));
    let (tracking, force, command) = (&done.metrics.tracking, &done.metrics.force, &done.metrics.force_command);
    list.push_axes("error_max", "m", tracking.max_m);
    list.push_axes("error_rms", "m", tracking.rms_m);
    list.push("outside_bound_ticks", json!(tracking.outside_ticks));
    list.push("foot_force_max_n", json!(done.extremes.foot_force_n));
    list.push("contact_force_max_n", json!(done.extremes.contact_force_n));
    list.push_axes("settled_rms", "percent", force.settled_rms_percent);
    list.push_axes("worst_hold_rms", "percent", force.worst_hold_rms_percent);
    list.push_axes("last_hold_rms", "percent", force.last_hold_rms_percent);
    list.push_axes("sliding_rms", "percent", force.sliding_rms_percent);
    list.push_axes("overshoot", "n", force.overshoot_n);
    list.push_axes("not_reached_error", "n", force.not_reached_error_n);
    list.push_axes("force_command_max", "n", command.max_n);
    list.push_axes("force_command_at_limit", "ticks", command.at_limit_ticks);
    list.push("torque_max_n_m", json!(done.extremes.largest_torque()));
    list.push("torque_limited_ticks", json!(done.extremes.limited_ticks));
    list.push("joint_work_j", json!(done.extremes.work_j));
    list.push("contact_energy_created_j", json!(done.metrics.integration.contact_energy_created_j));
    let integration = &done.metrics.integration;
    list.push("energy_error_j", json!(integration.energy_error_j));
    list.push("energy_range_j", json!(integration.energy_range_j));
    list.push("cut_substeps", json!(integration.cut));
    list.push("passages", json!(integration.passages));
    list.push("unconverged_substeps", json!(done.metrics.integration.unconverged));
    list.0
}

struct FigureList(Vec<(String, Value)>);

impl FigureList {
    fn push(&mut self, name: &str, value: Value) {
        self.0.push((name.to_owned(), value));
    }

    fn push_axes<T: serde::Serialize>(&mut self, name: &str, unit: &str, values: [T; 3]) {
        self.0.extend(AXES.iter().zip(values).map(|(axis, value)| (format!("{name}_{axis}_{unit}"), json!(value))));
    }
}

/// Header line of the CSV file.
#[must_use]
pub fn csv_head<'a>(keys: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<_> = figures(&Done::default()).into_iter().map(|(name, _)| name).collect();
    line(keys.map(str::to_owned).chain(names))
}

/// CSV line of a run.
#[must_use]
pub fn csv_line(values: &[&str], done: &Done) -> String {
    let cells = figures(done).into_iter().map(|(_, value)| match value {
        Value::Null => String::new(),
        Value::String(text) => text,
        other => other.to_string(),
    });
    line(values.iter().map(|value| (*value).to_owned()).chain(cells))
}

/// A CSV line with its newline, so that a file cut off between two writes has complete lines alone.
fn line(cells: impl Iterator<Item = String>) -> String {
    let mut text = cells.map(|cell| quoted(&cell)).collect::<Vec<_>>().join(",");
    text.push('\n');
    text
}

/// Quotes a cell as in RFC 4180.
fn quoted(cell: &str) -> String {
    if cell.contains(['"', ',', '\n', '\r']) { format!("\"{}\"", cell.replace('"', "\"\"")) } else { cell.to_owned() }
}

/// JSON object of a run: its values, its figures, and the metrics of its log.
#[must_use]
pub fn object<'a>(values: impl Iterator<Item = (&'a str, &'a str)>, done: &Done) -> Value {
    let values: Map<_, _> = values.map(|(key, value)| (key.to_owned(), json!(value))).collect();
    let mut object: Map<_, _> = figures(done).into_iter().collect();
    object.insert("values".to_owned(), Value::Object(values));
    object.insert("metrics".to_owned(), json!(done.metrics));
    Value::Object(object)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn done() -> Done {
        let mut done = Done { end: End::Failed("tick 7: \"no\", lower".to_owned()), ticks: 7, ..Done::default() };
        done.metrics.force.settled_rms_percent[2] = Some(0.25);
        done
    }

    #[test]
    fn csv_line_matches_header_and_quotes() {
        let head = csv_head(["controller.taper", "operator.2.desired_force"].into_iter());
        assert!(
            head.starts_with("controller.taper,operator.2.desired_force,completed,error,simulated_s,error_max_x_m,"),
            "{head}"
        );
        let line = csv_line(&["0.1", "[0, 0, 50]"], &done());
        let rest = line.strip_prefix("0.1,\"[0, 0, 50]\",false,\"tick 7: \"\"no\"\", lower\",0.007,0.0,").unwrap();
        assert_eq!(rest.matches(',').count() + 6, head.matches(',').count(), "{line}");
        assert!(line.ends_with('\n') && line.contains(",,0.25,"), "{line}");
    }

    #[test]
    fn json_object_has_values_figures_and_metrics() {
        let object = object([("seed", "3")].into_iter(), &done());
        assert_eq!((&object["values"]["seed"], &object["completed"]), (&json!("3"), &json!(false)));
        assert_eq!((&object["settled_rms_z_percent"], &object["settled_rms_x_percent"]), (&json!(0.25), &Value::Null));
        assert_eq!(object["metrics"]["force"]["settled_rms_percent"][2], 0.25);
    }
}
