//! How the gate's thread waits in realtime: for what, and how long. Meanwhile it has not got the gate.

use hapfic_ipc::{ArrivalPredictor, DeadlineTimer, IpcError, Listener, Wakes, clock, wait};
use hapfic_messages::PERIOD_NS;
use std::time::Duration;

/// How long the gate waits at most before it looks at its flags.
pub(super) const TIMEOUT: Duration = Duration::from_millis(20);
/// How often it looks for a state that is overdue.
const OVERDUE_POLL_INTERVAL: Duration = Duration::from_micros(500);

/// What the gate waits for.
#[derive(Clone, Copy, Debug)]
pub(super) struct PendingTick {
    /// The tick that is due.
    pub(super) tick: i64,
    /// The newest state's tick and time of publication; before the first the plant has the word.
    pub(super) newest: Option<(i64, u64)>,
    /// How long after its state a request may come, ns.
    pub(super) deadline_ns: u64,
    /// When the next can be looked out for, if it is.
    pub(super) predictor: Option<ArrivalPredictor>,
}

impl PendingTick {
    /// Whether the state of the tick that is due has come.
    pub(super) fn state_is_here(&self) -> bool {
        self.newest.is_some_and(|(newest, _)| newest == self.tick)
    }

    /// When those in reserve are called, and when the tick is missed, ns: as far as it can be foreseen.
    pub(super) fn call_and_due(&self) -> Option<(u64, u64)> {
        let (newest, stamp) = self.newest?;
        // A state that is still to come is due a period after the last one.
        let expected = stamp + (self.tick - newest).max(0) as u64 * PERIOD_NS;
        Some((expected + self.deadline_ns / 2, expected + self.deadline_ns))
    }
}

/// Why the wait is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Woken {
    /// Something came, or it is time to look at the clock.
    Look,
    /// The state is due shortly: there is time to go through what will have to be done.
    WarmUp,
}

/// The gate's eyes and ears.
#[derive(Debug)]
pub(super) struct ArrivalWait {
    state: Listener,
    request: Listener,
    /// Rings when a request is overdue; where the gate does not look out for it.
    deadline_timer: Option<DeadlineTimer>,
    /// Last tick for which there was a rehearsal, or no time for it.
    warmed_up: i64,
}

impl ArrivalWait {
    pub(super) fn new(state: Listener, request: Listener, deadline_timer: Option<DeadlineTimer>) -> Self {
        Self { state, request, deadline_timer, warmed_up: -1 }
    }

    /// Waits for a request, at most until it is late.
    pub(super) fn wait(&mut self, pending: &PendingTick) -> Result<Woken, IpcError> {
        let Some((call, due)) = pending.call_and_due() else {
            wait(&[&self.request], TIMEOUT)?;
            return Ok(Woken::Look);
        };
        if let Some(predictor) = &pending.predictor {
            if self.warmed_up < pending.tick {
                self.warmed_up = pending.tick;
                if predictor.sleep_until_window(pending.tick) {
                    return Ok(Woken::WarmUp);
                }
            }
            let limit = if pending.state_is_here() { call } else { u64::MAX };
            if predictor.watch(&[&self.request as &dyn Wakes, &self.state], pending.tick, limit) {
                return Ok(Woken::Look);
            }
        }
        let now = clock::now_ns();
        let most = match &self.deadline_timer {
            Some(deadline_timer) if now < call => {
                deadline_timer.set(call);
                Duration::MAX
            }
            _ if now < call => Duration::from_nanos(call - now),
            _ if now < due => Duration::from_nanos(due - now),
            _ => OVERDUE_POLL_INTERVAL,
        };
        wait(&[&self.request], most)?;
        Ok(Woken::Look)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_that_is_still_to_come_is_due_a_period_after_the_last() {
        let pending = PendingTick { tick: 7, newest: None, deadline_ns: 800_000, predictor: None };
        assert_eq!(pending.call_and_due(), None, "before the first the plant has the word");
        let here = PendingTick { newest: Some((7, 5_000_000)), ..pending };
        assert!(here.state_is_here());
        assert_eq!(here.call_and_due(), Some((5_400_000, 5_800_000)));
        let ahead = PendingTick { newest: Some((5, 5_000_000)), ..pending };
        assert!(!ahead.state_is_here());
        assert_eq!(ahead.call_and_due(), Some((7_400_000, 7_800_000)));
        let passed = PendingTick { newest: Some((9, 5_000_000)), ..pending };
        assert_eq!(passed.call_and_due(), Some((5_400_000, 5_800_000)));
    }
}
