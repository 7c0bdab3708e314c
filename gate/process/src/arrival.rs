//! How the gate's thread waits in realtime: for what, and how long. Meanwhile it has not got the gate.

use hapfic_ipc::{Alarm, Foresight, IpcError, Listener, Wakes, clock, wait};
use hapfic_messages::PERIOD_NS;
use std::time::Duration;

/// How long the gate waits at most before it looks at its flags.
pub(super) const PATIENCE: Duration = Duration::from_millis(20);
/// How often it looks for a state that is overdue.
const LOOK_AGAIN: Duration = Duration::from_micros(500);

/// What the gate waits for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outlook {
    /// The tick that is due.
    pub(super) tick: i64,
    /// The newest state's tick and time of publication; before the first the plant has the word.
    pub(super) newest: Option<(i64, u64)>,
    /// How long after its state a request may come, ns.
    pub(super) deadline_ns: u64,
    /// When the next can be looked out for, if it is.
    pub(super) foresight: Option<Foresight>,
}

impl Outlook {
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
    Rehearse,
}

/// The gate's eyes and ears.
#[derive(Debug)]
pub(super) struct Lookout {
    state: Listener,
    request: Listener,
    /// Rings when a request is overdue; where the gate does not look out for it.
    alarm: Option<Alarm>,
    /// Last tick for which there was a rehearsal, or no time for it.
    rehearsed: i64,
}

impl Lookout {
    pub(super) fn new(state: Listener, request: Listener, alarm: Option<Alarm>) -> Self {
        Self { state, request, alarm, rehearsed: -1 }
    }

    /// Waits for a request, at most until it is late.
    pub(super) fn wait(&mut self, outlook: &Outlook) -> Result<Woken, IpcError> {
        let Some((call, due)) = outlook.call_and_due() else {
            wait(&[&self.request], PATIENCE)?;
            return Ok(Woken::Look);
        };
        if let Some(foresight) = &outlook.foresight {
            if self.rehearsed < outlook.tick {
                self.rehearsed = outlook.tick;
                if foresight.approach(outlook.tick) {
                    return Ok(Woken::Rehearse);
                }
            }
            let limit = if outlook.state_is_here() { call } else { u64::MAX };
            if foresight.watch(&[&self.request as &dyn Wakes, &self.state], outlook.tick, limit) {
                return Ok(Woken::Look);
            }
        }
        let now = clock::now_ns();
        let most = match &self.alarm {
            Some(alarm) if now < call => {
                alarm.set(call);
                Duration::MAX
            }
            _ if now < call => Duration::from_nanos(call - now),
            _ if now < due => Duration::from_nanos(due - now),
            _ => LOOK_AGAIN,
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
        let outlook = Outlook { tick: 7, newest: None, deadline_ns: 800_000, foresight: None };
        assert_eq!(outlook.call_and_due(), None, "before the first the plant has the word");
        let here = Outlook { newest: Some((7, 5_000_000)), ..outlook };
        assert!(here.state_is_here());
        assert_eq!(here.call_and_due(), Some((5_400_000, 5_800_000)));
        let ahead = Outlook { newest: Some((5, 5_000_000)), ..outlook };
        assert!(!ahead.state_is_here());
        assert_eq!(ahead.call_and_due(), Some((7_400_000, 7_800_000)));
        let passed = Outlook { newest: Some((9, 5_000_000)), ..outlook };
        assert_eq!(passed.call_and_due(), Some((5_400_000, 5_800_000)));
    }
}
