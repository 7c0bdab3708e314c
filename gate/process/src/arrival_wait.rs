//! Wait of the gate's thread in realtime, during which the hand-off cell holds the gate.

use hapfic_ipc::{ArrivalPredictor, DeadlineTimer, IpcError, Listener, Wakes, clock, wait};
use hapfic_messages::PERIOD_NS;
use std::time::Duration;

/// Longest wait of the gate before it checks its flags.
pub(super) const TIMEOUT: Duration = Duration::from_millis(20);
/// Poll interval for a state that is overdue.
const OVERDUE_POLL_INTERVAL: Duration = Duration::from_micros(500);

/// Tick that the gate waits for.
#[derive(Clone, Copy, Debug)]
pub(super) struct PendingTick {
    /// The tick that is due.
    pub(super) tick: i64,
    /// Tick and publication time of the newest state; `None` before the first, which the plant sends at its own time.
    pub(super) newest: Option<(i64, u64)>,
    /// Deadline of a request, from its state [ns].
    pub(super) deadline_ns: u64,
    /// Arrival predictor, if busy-poll is enabled.
    pub(super) predictor: Option<ArrivalPredictor>,
}

impl PendingTick {
    /// Whether the state of the tick that is due has arrived.
    pub(super) fn state_is_here(&self) -> bool {
        self.newest.is_some_and(|(newest, _)| newest == self.tick)
    }

    /// Times of the call to the standby, and of the missed tick [ns]; predicted before the state comes.
    pub(super) fn call_and_due(&self) -> Option<(u64, u64)> {
        let (newest, stamp) = self.newest?;
        // A future state is due a period after the last.
        let expected = stamp + (self.tick - newest).max(0) as u64 * PERIOD_NS;
        Some((expected + self.deadline_ns / 2, expected + self.deadline_ns))
    }
}

/// Reason for the end of a wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum WakeReason {
    /// A message arrived, or a time is up: check again.
    Check,
    /// The state is due shortly: there is time for a cache warm-up.
    WarmUp,
}

/// Wait for states and requests.
#[derive(Debug)]
pub(super) struct ArrivalWait {
    state: Listener,
    request: Listener,
    /// Notifies `request` when a request is late; `None` if the gate polls.
    deadline_timer: Option<DeadlineTimer>,
    /// Last tick with a cache warm-up, or without time for it.
    warmed_up: i64,
}

impl ArrivalWait {
    pub(super) fn new(state: Listener, request: Listener, deadline_timer: Option<DeadlineTimer>) -> Self {
        Self { state, request, deadline_timer, warmed_up: -1 }
    }

    /// Waits for a request, at most until it is late.
    pub(super) fn wait(&mut self, pending: &PendingTick) -> Result<WakeReason, IpcError> {
        let Some((call, due)) = pending.call_and_due() else {
            wait(&[&self.request], TIMEOUT)?;
            return Ok(WakeReason::Check);
        };
        if let Some(predictor) = &pending.predictor {
            if self.warmed_up < pending.tick {
                self.warmed_up = pending.tick;
                if predictor.sleep_until_window(pending.tick) {
                    return Ok(WakeReason::WarmUp);
                }
            }
            let limit = if pending.state_is_here() { call } else { u64::MAX };
            if predictor.poll(&[&self.request as &dyn Wakes, &self.state], pending.tick, limit) {
                return Ok(WakeReason::Check);
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
        Ok(WakeReason::Check)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pending_tick_without_state_due_period_after_last() {
        let pending = PendingTick { tick: 7, newest: None, deadline_ns: 800_000, predictor: None };
        assert_eq!(pending.call_and_due(), None, "no time is known before the first state");
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
