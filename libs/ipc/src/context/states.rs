//! Choice of the state that a process works on next, and the wait for it.

use super::Context;
use crate::arrival_predictor::ArrivalPredictor;
use crate::clock;
use crate::doorbell::Wakes;
use crate::error::IpcError;
use crate::ports::Input;
use crate::realtime::SchedGrants;
use hapfic_messages::{Check, Clock, PERIOD_NS, State};

/// Whether a process may skip states in lockstep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gaps {
    /// Its answer depends on one state alone: a controller, whose ticks the other controller may have answered.
    Allowed,
    /// Its answer depends on the state before; it waits for a missing state until the supervisor detects the hang.
    Never,
}

impl Context {
    /// Enables busy-poll in [`next_state`](Self::next_state), from `before_us` before a state is due. The process calls
    /// it when it is [ready](Self::ready).
    ///
    /// Only a real-time thread that is pinned to a core polls: another would keep the plant from the processor.
    pub fn enable_busy_poll(&mut self, before_us: u32) {
        if self.clock == Clock::Realtime && self.granted.has(SchedGrants::FIFO) && self.granted.has(SchedGrants::PINNED) {
            self.predictor = ArrivalPredictor::new(before_us);
        }
    }

    /// Sleeps until a tick's busy-poll window opens, if enabled. Returns whether there is time for a cache warm-up.
    #[must_use]
    pub fn sleep_until_window(&self, tick: i64) -> bool {
        self.predictor.as_ref().is_some_and(|predictor| predictor.sleep_until_window(tick))
    }

    /// State to work on after tick `seen`: in lockstep the next, in realtime the newest. `None`: the process must end.
    ///
    /// Calls `idle_work` before each wait, which is for the states or for the input `instead`. If
    /// [enabled](Self::enable_busy_poll), it polls for the states, but not for `instead`.
    ///
    /// # Errors
    /// [`IpcError`] if waiting or receiving fails.
    pub fn next_state(
        &mut self,
        input: &mut Input<State>,
        seen: i64,
        gaps: Gaps,
        instead: Option<&dyn Wakes>,
        mut idle_work: impl FnMut(),
    ) -> Result<Option<State>, IpcError> {
        loop {
            let found = match self.clock {
                Clock::Lockstep => self.state_after(input, seen, gaps)?,
                Clock::Realtime => self.newest_state(input, seen)?,
            };
            if found.is_some() {
                return Ok(found);
            }
            idle_work();
            if instead.is_none()
                && let Some(predictor) = &self.predictor
                && predictor.poll(&[&*input], seen.saturating_add(1), u64::MAX)
                && self.running()
            {
                continue;
            }
            let awaited: &dyn Wakes = match instead {
                Some(other) => other,
                None => &*input,
            };
            if !self.wait(&[awaited], seen)? {
                return Ok(None);
            }
        }
    }

    fn newest_state(&mut self, input: &mut Input<State>, seen: i64) -> Result<Option<State>, IpcError> {
        let mut found = None;
        while let Some(state) = input.next()? {
            if self.is_news(&state, seen) {
                found = Some(state);
                let now = clock::now_ns();
                if let Some(predictor) = &mut self.predictor {
                    predictor.observe(&state, now);
                }
                // A state younger than a period is the newest.
                if now.saturating_sub(state.stamp_ns) < PERIOD_NS {
                    break;
                }
            }
        }
        Ok(found)
    }

    /// Next state after tick `seen`. States come from the plant and, after its death, from its successor, which sends its last ones again, in no
    /// mutual order.
    fn state_after(&mut self, input: &mut Input<State>, seen: i64, gaps: Gaps) -> Result<Option<State>, IpcError> {
        while let Some(state) = input.next()? {
            if self.is_news(&state, seen) {
                self.states.insert(state);
            }
        }
        let next = self.states.after(seen).filter(|state| gaps == Gaps::Allowed || state.tick == seen + 1);
        Ok(next.copied())
    }

    /// Whether a state is new; rejects an invalid or older state. A repetition is neither new nor rejected: a restarted
    /// plant republishes the last state of its predecessor.
    fn is_news(&mut self, state: &State, seen: i64) -> bool {
        let bad = state.check().is_err() || state.tick < seen;
        if bad {
            self.reject();
        }
        !bad && state.tick > seen
    }
}
