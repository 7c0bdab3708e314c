//! Which parameter set is in force at a tick.

use crate::vector;
use hapfic_log::proto;

/// Most sets that may wait for their tick; the operator announces one at a time.
const MOST_SETS: usize = 64;

/// What figures show of a parameter set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ParameterSet {
    pub(crate) version: u64,
    pub(crate) effective_tick: i64,
    pub(crate) target: [f64; 3],
    pub(crate) desired_force: [f64; 3],
    pub(crate) stiffness: [f64; 3],
    pub(crate) max_force: [f64; 3],
    pub(crate) bound: [f64; 3],
}

impl ParameterSet {
    /// `None` if a vector has not three finite elements.
    pub(crate) fn new(message: &proto::Operator) -> Option<Self> {
        Some(Self {
            version: message.version,
            effective_tick: message.effective_tick,
            target: vector(&message.target_position)?,
            desired_force: vector(&message.desired_force)?,
            stiffness: vector(&message.stiffness)?,
            max_force: vector(&message.max_force)?,
            bound: vector(&message.position_bound)?,
        })
    }

    /// What is new in it, in words.
    pub(crate) fn changes(&self, before: Option<&Self>) -> String {
        let list = |v: [f64; 3]| format!("({}, {}, {})", v[0], v[1], v[2]);
        let fields: [(&str, &str, fn(&Self) -> [f64; 3]); 5] = [
            ("target", "m", |set| set.target),
            ("F_d", "N", |set| set.desired_force),
            ("K0", "N/m", |set| set.stiffness),
            ("F_max", "N", |set| set.max_force),
            ("x_b", "m", |set| set.bound),
        ];
        let changed: Vec<_> = fields
            .iter()
            .filter(|(_, _, field)| before.is_none_or(|before| field(before) != field(self)))
            .map(|(name, unit, field)| format!("{name} {} {unit}", list(field(self))))
            .collect();
        if changed.is_empty() { "no change of a vector".to_owned() } else { changed.join(", ") }
    }
}

/// The set in force and those to come.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sets {
    sets: Vec<ParameterSet>,
}

impl Sets {
    /// Takes a set that has been announced; returns what it changes, in words.
    pub(crate) fn announce(&mut self, set: ParameterSet) -> String {
        let at = self.sets.partition_point(|other| (other.effective_tick, other.version) <= (set.effective_tick, set.version));
        let changes = set.changes(at.checked_sub(1).and_then(|before| self.sets.get(before)));
        self.sets.insert(at, set);
        if self.sets.len() > MOST_SETS {
            self.sets.remove(0);
        }
        changes
    }

    /// The set in force at a tick; ticks come about in order.
    pub(crate) fn in_force(&mut self, tick: i64) -> Option<&ParameterSet> {
        // A few ticks late is soon enough to forget: topics do not come in step.
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

    fn set(version: u64, effective_tick: i64, force: f64) -> ParameterSet {
        ParameterSet {
            version,
            effective_tick,
            target: [0.0; 3],
            desired_force: [0.0, 0.0, force],
            stiffness: [1.0; 3],
            max_force: [1.0; 3],
            bound: [1.0; 3],
        }
    }

    #[test]
    fn a_set_counts_from_its_tick_on_and_says_what_it_changes() {
        let mut sets = Sets::default();
        assert!(sets.announce(set(1, 0, 10.0)).starts_with("target"));
        assert_eq!(sets.announce(set(2, 100, 50.0)), "F_d (0, 0, 50) N");
        let mut version = |tick| sets.in_force(tick).map(|set| set.version);
        assert_eq!([-1, 0, 99, 100, 5000].map(&mut version), [None, Some(1), Some(1), Some(2), Some(2)]);
    }
}
