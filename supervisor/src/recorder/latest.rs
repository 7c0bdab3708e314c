//! Latest state and parameter sets of a run, for the thread that answers operators.

use super::RecordedMessage;
use hapfic_messages::{Operator, State};
use hapfic_simulation::conditions::TaskReport;
use std::sync::Mutex;

/// Latest messages that the recorder has received. No real-time thread locks them.
#[derive(Debug, Default)]
pub struct LatestMessages {
    state: Mutex<Option<State>>,
    operator: Mutex<Option<Operator>>,
    tasks: Mutex<Vec<TaskReport>>,
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

    /// Conditions of the task that hold or have held.
    #[must_use]
    pub fn tasks(&self) -> Vec<TaskReport> {
        self.tasks.lock().map(|tasks| tasks.clone()).unwrap_or_default()
    }

    pub(super) fn set_tasks(&self, report: Vec<TaskReport>) {
        if let Ok(mut tasks) = self.tasks.lock() {
            *tasks = report;
        }
    }

    /// Takes the newest messages of a batch in the order of ticks.
    pub(super) fn update(&self, batch: &[RecordedMessage]) {
        let states = batch.iter().rev().find_map(|record| if let RecordedMessage::State(m) = record { Some(*m) } else { None });
        let sets = batch.iter().filter_map(|record| if let RecordedMessage::Operator(m) = record { Some(*m) } else { None });
        if let (Some(state), Ok(mut latest)) = (states, self.state.lock()) {
            *latest = Some(state);
        }
        if let (Some(operator), Ok(mut latest)) = (sets.max_by_key(|sets| sets.next.version), self.operator.lock()) {
            *latest = Some(operator);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hapfic_messages::Parameters;

    #[test]
    fn latest_keeps_newest_of_each_kind() {
        let latest = LatestMessages::default();
        assert!(latest.state().is_none() && latest.operator().is_none());
        let state = |tick| RecordedMessage::State(State { tick, ..State::default() });
        let sets = |version| {
            let next = Parameters { version, ..Parameters::default() };
            RecordedMessage::Operator(Operator { next, ..Operator::default() })
        };
        latest.update(&[sets(3), sets(2), state(7), state(8)]);
        latest.update(&[]);
        assert_eq!((latest.state().map(|s| s.tick), latest.operator().map(|o| o.next.version)), (Some(8), Some(3)));
    }
}
