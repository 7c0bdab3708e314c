//! What viewers are shown of a tick.

use hapfic_ipc::topic;
use hapfic_log::proto;
use hapfic_messages::{Parameters, Reference, State};
use std::collections::VecDeque;

/// Ticks that may be waiting for their command at once, and parameter sets that may be in force among them.
const WAITING: usize = 2 * topic::RECORDER_DEPTH;

/// What has come of the ticks that are to be shown. A tick is put together when its command has come: everything else of it has
/// then, too.
#[derive(Default)]
pub(super) struct Shown {
    states: VecDeque<(State, proto::State)>,
    references: VecDeque<Reference>,
    operators: VecDeque<Parameters>,
}

/// A tick as it is shown.
pub(super) struct Picture {
    pub(super) state: State,
    pub(super) logged: proto::State,
    pub(super) reference: Option<[f64; 3]>,
    /// In force at the tick.
    pub(super) parameters: Option<Parameters>,
}

fn keep<T>(queue: &mut VecDeque<T>, value: T) {
    if queue.len() == WAITING {
        queue.pop_front();
    }
    queue.push_back(value);
}

impl Shown {
    pub(super) fn state(&mut self, state: &State, logged: proto::State) {
        keep(&mut self.states, (*state, logged));
    }

    pub(super) fn reference(&mut self, reference: &Reference) {
        keep(&mut self.references, *reference);
    }

    /// Keeps a parameter set that is newer than all others. Says whether it was.
    pub(super) fn parameters(&mut self, set: &Parameters) -> bool {
        let newer = self.operators.back().is_none_or(|last| set.version > last.version);
        if newer {
            keep(&mut self.operators, *set);
        }
        newer
    }

    /// A tick whose command has come; forgets what is older.
    pub(super) fn take(&mut self, tick: i64) -> Option<Picture> {
        while self.states.front().is_some_and(|(s, _)| s.tick < tick) {
            self.states.pop_front();
        }
        while self.references.front().is_some_and(|r| r.tick < tick) {
            self.references.pop_front();
        }
        // The last one in force stays.
        while self.operators.get(1).is_some_and(|p| p.effective_tick <= tick) {
            self.operators.pop_front();
        }
        let (state, logged) = self.states.pop_front_if(|(s, _)| s.tick == tick)?;
        let reference = self.references.front().filter(|r| r.tick == tick).map(|r| r.position);
        Some(Picture { state, logged, reference, parameters: self.operators.front().copied() })
    }
}
