//! The messages of a viewer frame, collected by tick.

use hapfic_ipc::topic;
use hapfic_log::proto;
use hapfic_messages::{Parameters, Reference, State};
use std::collections::VecDeque;

/// Ticks that may wait for their command, and parameter sets that may be in force among them.
const CAPACITY: usize = 2 * topic::RECORDER_DEPTH;

/// Collects the messages of viewer frames. The command of a tick comes last and completes its frame.
#[derive(Default)]
pub(super) struct ViewerFrames {
    states: VecDeque<(State, proto::State)>,
    references: VecDeque<Reference>,
    operators: VecDeque<Parameters>,
}

/// Viewer frame of a tick.
pub(super) struct ViewerFrame {
    pub(super) state: State,
    pub(super) logged: proto::State,
    pub(super) reference: Option<[f64; 3]>,
    /// Parameters in force at the tick.
    pub(super) parameters: Option<Parameters>,
}

fn push_bounded<T>(queue: &mut VecDeque<T>, value: T) {
    if queue.len() == CAPACITY {
        queue.pop_front();
    }
    queue.push_back(value);
}

impl ViewerFrames {
    pub(super) fn state(&mut self, state: &State, logged: proto::State) {
        push_bounded(&mut self.states, (*state, logged));
    }

    pub(super) fn reference(&mut self, reference: &Reference) {
        push_bounded(&mut self.references, *reference);
    }

    /// Adds a parameter set if it is newer than all others; returns whether it is.
    pub(super) fn parameters(&mut self, set: &Parameters) -> bool {
        let newer = self.operators.back().is_none_or(|last| set.version > last.version);
        if newer {
            push_bounded(&mut self.operators, *set);
        }
        newer
    }

    /// Returns the frame of a tick after its command, and drops older frames.
    pub(super) fn take(&mut self, tick: i64) -> Option<ViewerFrame> {
        while self.states.front().is_some_and(|(s, _)| s.tick < tick) {
            self.states.pop_front();
        }
        while self.references.front().is_some_and(|r| r.tick < tick) {
            self.references.pop_front();
        }
        // The set in force stays.
        while self.operators.get(1).is_some_and(|p| p.effective_tick <= tick) {
            self.operators.pop_front();
        }
        let (state, logged) = self.states.pop_front_if(|(s, _)| s.tick == tick)?;
        let reference = self.references.front().filter(|r| r.tick == tick).map(|r| r.position);
        Some(ViewerFrame { state, logged, reference, parameters: self.operators.front().copied() })
    }
}
