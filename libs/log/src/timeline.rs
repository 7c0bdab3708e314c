//! Parameter sets of a log as the `[[operator]]` entries of a scenario.
//!
//! The log holds the sets of the script and those changed during the run. Written as a script, all sets take effect at
//! the same ticks again. A lockstep run of the same scenario with these entries instead of its own is the same run.

use crate::proto::Operator;
use crate::{LogError, TICK_NS};
use serde_json::{Map, Value};
use std::fmt::Write as _;

/// Fields of a set that no operator changes: its head, and what is the same over a run.
const NO_PARAMETERS: [&str; 9] = [
    "version",
    "effective_tick",
    "task",
    "posture",
    "posture_stiffness",
    "posture_damping",
    "joint_damping",
    "limit_margin",
    "limit_stiffness",
];
/// Parameters of a pose task.
const ROTATION: [&str; 9] = [
    "target_orientation",
    "desired_moment",
    "rotation_stiffness",
    "max_moment",
    "rotation_bound",
    "rotation_damping",
    "moment_resolution",
    "mean_turn_speed",
    "max_turn_acceleration",
];
/// Parameter written for a set without a change: every set is an entry, and an entry must name a parameter.
const UNCHANGED: &str = "desired_force";
/// Ticks of a second.
const TICKS_PER_S: f64 = 1e9 / TICK_NS as f64;

/// Returns the sets of a log in the order of their versions, and the read errors: one, or one for each damaged part.
#[must_use]
pub fn sets(reader: impl Iterator<Item = Result<crate::LogMessage, LogError>>) -> (Vec<Operator>, Vec<LogError>) {
    let (mut sets, mut errors) = (Vec::new(), Vec::new());
    for entry in reader {
        match entry {
            Ok(entry) => {
                if let crate::Record::Operator(set) = entry.record {
                    sets.push(set);
                }
            }
            Err(error) => errors.push(error),
        }
    }
    (sorted(sets), errors)
}

fn sorted(mut sets: Vec<Operator>) -> Vec<Operator> {
    sets.sort_by_key(|set| set.version);
    sets.dedup_by_key(|set| set.version);
    sets
}

/// Formats the entries: the first names every parameter, each later entry those that differ from the previous set.
///
/// Numbers keep all their digits.
#[must_use]
pub fn entries(sets: &[Operator]) -> String {
    let mut out = String::new();
    let mut before = None;
    for set in sets {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "\n[[operator]]\nat_s = {:?}", set.effective_tick as f64 / TICKS_PER_S);
        let mut lines = changed(before, set);
        if lines.is_empty() {
            lines.extend(changed(None, set).into_iter().filter(|change| change.name == UNCHANGED));
        }
        for ParameterChange { name, now, .. } in lines {
            let _ = writeln!(out, "{name} = {}", toml(&now));
        }
        before = Some(set);
    }
    out
}

/// Parameter in which two sets differ.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterChange {
    /// Name in the log and in scenarios.
    pub name: String,
    /// Value in the previous set; null if there is none.
    pub before: Value,
    /// Present value.
    pub now: Value,
}

/// Lists the parameters that differ between two sets; all of `set` without a previous set. Excludes version and tick.
#[must_use]
pub fn changed(before: Option<&Operator>, set: &Operator) -> Vec<ParameterChange> {
    let mut old = before.map(parameters);
    let list = parameters(set).into_iter().filter_map(|(name, now)| match &mut old {
        None => Some(ParameterChange { name, before: Value::Null, now }),
        Some(old) => {
            let before = old.remove(&name).unwrap_or_default();
            (before != now).then_some(ParameterChange { name, before, now })
        }
    });
    list.collect()
}

/// Parameters of a set, by their names in the log and in scenarios.
fn parameters(set: &Operator) -> Map<String, Value> {
    let mut all = match serde_json::to_value(set) {
        Ok(Value::Object(all)) => all,
        _ => Map::new(),
    };
    NO_PARAMETERS.iter().for_each(|name| drop(all.remove(*name)));
    if set.rotation_stiffness.is_empty() {
        ROTATION.iter().for_each(|name| drop(all.remove(*name)));
    }
    all
}

/// Formats a value as TOML. Only numbers differ from JSON: they must keep their decimal point.
fn toml(value: &Value) -> String {
    match value {
        Value::Number(number) => number.as_f64().map_or_else(|| number.to_string(), |number| format!("{number:?}")),
        Value::Array(items) => format!("[{}]", items.iter().map(toml).collect::<Vec<_>>().join(", ")),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(version: u64, tick: i64, force: f64) -> Operator {
        Operator {
            version,
            effective_tick: tick,
            desired_force: vec![0.0, 0.1 + 0.2, force],
            search: "sign".to_owned(),
            taper: 1e-7,
            gravity_compensation: true,
            ..Operator::default()
        }
    }

    #[test]
    fn entries_after_first_name_only_differences() {
        let text = entries(&[set(1, 0, 5.0), set(2, 1234, 80.0), set(3, 1240, 80.0)]);
        let parts: Vec<_> = text.split("\n[[operator]]\n").collect();
        assert_eq!(parts.len(), 4, "{text}");
        for line in [
            "at_s = 0.0",
            "desired_force = [0.0, 0.30000000000000004, 5.0]",
            "search = \"sign\"",
            "taper = 1e-7",
            "gravity_compensation = true",
        ] {
            assert!(parts[1].lines().any(|l| l == line), "'{line}' is not in {}", parts[1]);
        }
        assert!(!text.contains("version") && !text.contains("effective_tick"));
        assert_eq!(parts[2], "at_s = 1.234\ndesired_force = [0.0, 0.30000000000000004, 80.0]\n");
        // An entry without a parameter does not load, and its version would be missing.
        assert_eq!(parts[3], "at_s = 1.24\ndesired_force = [0.0, 0.30000000000000004, 80.0]\n");
    }

    #[test]
    fn changed_lists_every_parameter_kind_but_no_version_or_tick() {
        let old = set(1, 0, 5.0);
        assert!(changed(Some(&old), &set(2, 99, 5.0)).is_empty());
        let new = Operator {
            search: "tapered".to_owned(),
            taper: 0.2,
            stall_release: true,
            mean_speed: 0.3,
            reset_policy: "never".to_owned(),
            ..set(2, 99, 6.0)
        };
        let found = changed(Some(&old), &new);
        let mut names: Vec<_> = found.iter().map(|change| change.name.as_str()).collect();
        names.sort_unstable();
        assert_eq!(names, ["desired_force", "mean_speed", "reset_policy", "search", "stall_release", "taper"]);
        let search =
            found.iter().find(|change| change.name == "search").map(|change| (change.before.as_str(), change.now.as_str()));
        assert_eq!(search, Some((Some("sign"), Some("tapered"))));
        let all = changed(None, &new);
        assert!(all.len() > names.len() && all.iter().all(|change| change.before.is_null()), "{all:?}");
        assert!(all.iter().all(|change| !NO_PARAMETERS.contains(&change.name.as_str())));
    }
}
