//! Which state a process works on next, and how it waits for it.

use super::Context;
use crate::arrival_predictor::ArrivalPredictor;
use crate::bus::Input;
use crate::clock;
use crate::doorbell::Wakes;
use crate::error::IpcError;
use crate::realtime::SchedGrants;
use hapfic_messages::{Check, Clock, PERIOD_NS, State};

/// Whether a process may pass over states in lockstep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gaps {
    /// It answers each state by itself: one of two controllers, that may find ticks done by the other.
    Allowed,
    /// What it makes of a state needs the one before; it waits for a state that is missing, until the supervisor sees it hang.
    Never,
}

impl Context {
    /// Has [`next_state`](Self::next_state) look out for states from `before_us` before they are due, instead of sleeping until they
    /// come. Only a real-time thread on a core of its choice does: another would keep the plant from the processor. To be called when
    /// [ready](Self::ready).
    pub fn enable_busy_poll(&mut self, before_us: u32) {
        if self.clock == Clock::Realtime && self.granted.has(SchedGrants::FIFO) && self.granted.has(SchedGrants::PINNED) {
            self.predictor = ArrivalPredictor::new(before_us);
        }
    }

    /// Sleeps until shortly before the state of a tick is due, where it is looked out for. Says whether there is time for a rehearsal.
    #[must_use]
    pub fn sleep_until_window(&self, tick: i64) -> bool {
        self.predictor.as_ref().is_some_and(|predictor| predictor.sleep_until_window(tick))
    }

    /// The state to work on after tick `seen`: in lockstep the next one, in realtime the newest. `None` when the process should
    /// end. `slack` is called before each wait, which is for the states themselves or for something `instead`. States are
    /// [looked out](Self::look_out) for where that is wished, but not `instead` of something else.
    ///
    /// # Errors
    /// [`IpcError`] if waiting or receiving fails.
    pub fn next_state(
        &mut self,
        input: &mut Input<State>,
        seen: i64,
        gaps: Gaps,
        instead: Option<&dyn Wakes>,
        mut slack: impl FnMut(),
    ) -> Result<Option<State>, IpcError> {
        loop {
            let found = match self.clock {
                Clock::Lockstep => self.state_after(input, seen, gaps)?,
                Clock::Realtime => self.newest_state(input, seen)?,
            };
            if found.is_some() {
                return Ok(found);
            }
            slack();
            if instead.is_none()
                && let Some(predictor) = &self.predictor
                && predictor.watch(&[&*input], seen.saturating_add(1), u64::MAX)
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
                // One that is not a period old is the newest.
                if now.saturating_sub(state.stamp_ns) < PERIOD_NS {
                    break;
                }
            }
        }
        Ok(found)
    }

    /// States come from the plant and, after its death, from the supervisor as well, in no order between the two.
    fn state_after(&mut self, input: &mut Input<State>, seen: i64, gaps: Gaps) -> Result<Option<State>, IpcError> {
        while let Some(state) = input.next()? {
            if self.is_news(&state, seen) {
                self.states.insert(state);
            }
        }
        let next = self.states.after(seen).filter(|state| gaps == Gaps::Allowed || state.tick == seen + 1);
        Ok(next.copied())
    }

    /// Counts what is damaged or older than what has been seen. The same once more is neither: a successor of the plant says again
    /// what its forerunner said last.
    fn is_news(&mut self, state: &State, seen: i64) -> bool {
        let bad = state.check().is_err() || state.tick < seen;
        if bad {
            self.reject();
        }
        !bad && state.tick > seen
    }
}
