//! Parameter sets of a log, by tick.

use crate::vector;
use hapfic_log::{proto, timeline};
use serde_json::Value;

/// Most sets ahead of their tick; the operator announces a single set at a time.
const MAX_SETS: usize = 64;

/// Parameters with their short names and units.
const SHORT: [(&str, &str, &str); 9] = [
    ("target_position", "target", " m"),
    ("desired_force", "F_d", " N"),
    ("stiffness", "K0", " N/m"),
    ("max_force", "F_max", " N"),
    ("position_bound", "x_b", " m"),
    ("reset_policy", "reset", ""),
    ("mean_speed", "mean_speed", " m/s"),
    ("max_acceleration", "max_acceleration", " m/s²"),
    ("force_resolution", "force_resolution", " N"),
];
/// Number of salient parameters, which describe the first set of a run.
const SALIENT: usize = 5;

/// Parameter set, with the vectors of the figures.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ParameterSet {
    pub(crate) version: u64,
    pub(crate) effective_tick: i64,
    pub(crate) desired_force: [f64; 3],
    pub(crate) max_force: [f64; 3],
    pub(crate) bound: [f64; 3],
    /// T_max [N m] and x_b,R [rad]; `None` in a position task.
    pub(crate) max_moment: Option<[f64; 3]>,
    pub(crate) rotation_bound: Option<[f64; 3]>,
    message: proto::Operator,
}

impl ParameterSet {
    /// Returns `None` unless every vector has three finite elements.
    pub(crate) fn new(message: &proto::Operator) -> Option<Self> {
        vector(&message.target_position)?;
        vector(&message.stiffness)?;
        Some(Self {
            version: message.version,
            effective_tick: message.effective_tick,
            desired_force: vector(&message.desired_force)?,
            max_force: vector(&message.max_force)?,
            bound: vector(&message.position_bound)?,
            max_moment: vector(&message.max_moment),
            rotation_bound: vector(&message.rotation_bound),
            message: message.clone(),
        })
    }

    /// Describes the changes against the previous set.
    pub(crate) fn changes(&self, before: Option<&Self>) -> String {
        let salient = |name: &str| before.is_some() || SHORT[..SALIENT].iter().any(|short| short.0 == name);
        let changed = timeline::changed(before.map(|before| &before.message), &self.message);
        let words: Vec<_> = changed.iter().filter(|change| salient(&change.name)).map(words).collect();
        if words.is_empty() { "no change".to_owned() } else { words.join(", ") }
    }
}

fn words(change: &timeline::ParameterChange) -> String {
    let short = SHORT.iter().find(|short| short.0 == change.name);
    let (name, unit) = short.map_or((change.name.as_str(), ""), |short| (short.1, short.2));
    format!("{name} {}{unit}", text(&change.now))
}

fn text(value: &Value) -> String {
    match value {
        Value::Array(list) => format!("({})", list.iter().map(text).collect::<Vec<_>>().join(", ")),
        Value::String(text) => text.clone(),
        Value::Bool(true) => "on".to_owned(),
        Value::Bool(false) => "off".to_owned(),
        // Without the decimal point that JSON gives to whole numbers.
        value => value.as_f64().map_or_else(|| value.to_string(), |number| number.to_string()),
    }
}

/// The set in force and the later sets.
#[derive(Clone, Debug, Default)]
pub(crate) struct ParameterSets {
    sets: Vec<ParameterSet>,
}

impl ParameterSets {
    /// Adds an announced set; returns a description of its changes.
    pub(crate) fn add_set(&mut self, set: ParameterSet) -> String {
        let at = self.sets.partition_point(|other| (other.effective_tick, other.version) <= (set.effective_tick, set.version));
        let changes = set.changes(at.checked_sub(1).and_then(|before| self.sets.get(before)));
        self.sets.insert(at, set);
        if self.sets.len() > MAX_SETS {
            self.sets.remove(0);
        }
        changes
    }

    /// Returns the set in force at a tick; ticks arrive roughly in order.
    pub(crate) fn in_force(&mut self, tick: i64) -> Option<&ParameterSet> {
        // Old sets are dropped late, because the topics are not synchronous.
        const LATE: i64 = 1024;
        let old = self.sets.partition_point(|set| set.effective_tick.saturating_add(LATE) <= tick);
        self.sets.drain(..old.saturating_sub(1));
        let begun = self.sets.partition_point(|set| set.effective_tick <= tick);
        begun.checked_sub(1).and_then(|last| self.sets.get(last))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(version: u64, effective_tick: i64, force: f64) -> proto::Operator {
        proto::Operator {
            version,
            effective_tick,
            target_position: vec![0.0; 3],
            desired_force: vec![0.0, 0.0, force],
            stiffness: vec![1.0; 3],
            max_force: vec![1.0; 3],
            position_bound: vec![1.0; 3],
            reset_policy: "contact_loss".to_owned(),
            search: "tapered".to_owned(),
            ..proto::Operator::default()
        }
    }

    fn add_set(sets: &mut ParameterSets, message: &proto::Operator) -> Option<String> {
        ParameterSet::new(message).map(|set| sets.add_set(set))
    }

    #[test]
    fn sets_set_is_in_force_from_its_tick_and_lists_changes() {
        let mut sets = ParameterSets::default();
        let start = add_set(&mut sets, &message(1, 0, 10.0)).unwrap_or_default();
        assert!(start.contains("F_d (0, 0, 10) N") && !start.contains("search"), "{start}");
        assert_eq!(add_set(&mut sets, &message(2, 100, 50.0)).as_deref(), Some("F_d (0, 0, 50) N"));
        let mut version = |tick| sets.in_force(tick).map(|set| set.version);
        assert_eq!([-1, 0, 99, 100, 5000].map(&mut version), [None, Some(1), Some(1), Some(2), Some(2)]);
        let cut_off = proto::Operator { stiffness: vec![1.0], ..message(3, 200, 50.0) };
        assert_eq!(add_set(&mut sets, &cut_off), None);
    }

    #[test]
    fn sets_policy_and_speed_changes_are_listed() {
        let mut sets = ParameterSets::default();
        let mut next = message(1, 0, 10.0);
        let mut change = |alter: fn(&mut proto::Operator)| {
            alter(&mut next);
            next.version += 1;
            next.effective_tick += 10;
            add_set(&mut sets, &next).unwrap_or_default()
        };
        change(|_| {});
        assert_eq!(change(|set| set.reset_policy = "never".to_owned()), "reset never");
        assert_eq!(change(|set| set.search = "sign".to_owned()), "search sign");
        assert_eq!(change(|set| set.taper = 0.2), "taper 0.2");
        assert_eq!(change(|set| set.mean_speed = 0.3), "mean_speed 0.3 m/s");
        assert_eq!(change(|set| set.stall_release = true), "stall_release on");
        assert_eq!(change(|_| {}), "no change");
    }
}
