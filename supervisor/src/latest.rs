//! Latest messages of a run, for the thread that answers operators and for the progress line.
//!
//! The main thread receives them itself, so they are there without a recorder.

use hapfic_messages::{Operator, Reference, State};
use std::sync::Mutex;

/// Latest messages. No real-time thread locks them.
#[derive(Debug, Default)]
pub struct LatestMessages {
    state: Mutex<Option<State>>,
    operator: Mutex<Option<Operator>>,
    snapshot: Mutex<StatusSnapshot>,
}

/// Snapshot for the progress line and for `hapfic status`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StatusSnapshot {
    /// Simulated time [s].
    pub time_s: f64,
    /// Position of the foot [m].
    pub foot_position: [f64; 3],
    /// F [N].
    pub foot_force: [f64; 3],
    /// F_d [N].
    pub desired_force: [f64; 3],
    /// Periods by which the plant's timer was late so far.
    pub late: u64,
    /// x - x_d [m].
    pub tracking: [f64; 3],
    /// x_b [m].
    pub bound: [f64; 3],
    /// Version of the parameters in force.
    pub version: u64,
}

impl LatestMessages {
    /// Latest state; `None` before the first.
    #[must_use]
    pub fn state(&self) -> Option<State> {
        self.state.lock().ok().and_then(|state| *state)
    }

    /// Parameter sets published last; `None` before the first.
    #[must_use]
    pub fn operator(&self) -> Option<Operator> {
        self.operator.lock().ok().and_then(|operator| *operator)
    }

    /// Snapshot of the latest messages; all zero before the first.
    #[must_use]
    pub fn snapshot(&self) -> StatusSnapshot {
        self.snapshot.lock().map(|snapshot| *snapshot).unwrap_or_default()
    }

    /// Takes parameter sets, unless newer ones are there.
    pub fn set_operator(&self, sets: Operator) {
        if let Ok(mut latest) = self.operator.lock()
            && latest.is_none_or(|latest| sets.next.version >= latest.next.version)
        {
            *latest = Some(sets);
        }
    }

    /// Takes the newest state, with the reference of its tick.
    pub fn update(&self, state: &State, reference: Option<&Reference>) {
        let parameters = self.operator().map(|sets| *sets.at(state.tick));
        if let (Ok(mut latest), Ok(mut snapshot)) = (self.state.lock(), self.snapshot.lock()) {
            *latest = Some(*state);
            *snapshot = StatusSnapshot {
                time_s: state.time_ns as f64 * 1e-9,
                foot_position: state.foot_position,
                foot_force: state.foot_force,
                desired_force: parameters.map_or([0.0; 3], |p| p.desired_force),
                late: state.slipped,
                tracking: reference.map_or([0.0; 3], |r| std::array::from_fn(|i| state.foot_position[i] - r.position[i])),
                bound: parameters.map_or([0.0; 3], |p| p.position_bound),
                version: parameters.map_or(0, |p| p.version),
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hapfic_messages::Parameters;

    #[test]
    fn latest_keeps_newest_sets_and_takes_those_in_force() {
        let latest = LatestMessages::default();
        assert!(latest.state().is_none() && latest.operator().is_none());
        let sets = |version, tick| {
            let set = |version, effective_tick| Parameters {
                version,
                effective_tick,
                desired_force: [0.0, 0.0, version as f64],
                ..Parameters::default()
            };
            Operator { current: set(version - 1, 0), next: set(version, tick) }
        };
        latest.set_operator(sets(3, 8));
        latest.set_operator(sets(2, 4));
        let state = |tick| State { tick, foot_position: [1.0, 2.0, 3.0], ..State::default() };
        latest.update(&state(7), None);
        assert_eq!((latest.snapshot().version, latest.snapshot().desired_force[2]), (2, 2.0));
        latest.update(&state(8), Some(&Reference { position: [1.0, 1.0, 1.0], ..Reference::default() }));
        assert_eq!((latest.snapshot().version, latest.snapshot().tracking), (3, [0.0, 1.0, 2.0]));
        assert_eq!(latest.state().map(|s| s.tick), Some(8));
    }
}
