//! When the next state is due, so that those who are waited for need not sleep until it comes.
//!
//! Waking a thread costs those who wait for it two system calls and a change of threads. The plant's states come by an absolute timer,
//! so each tells when the next is due; whoever answers it is awake some microseconds before, and looks at the doorbell until it rings
//! ([`watch`]). What is late by more than a little is waited for asleep, as everything else.

use crate::clock;
use crate::doorbell::{Wakes, watch};
use hapfic_messages::{PERIOD_NS, State};

/// How long is looked out for a state that should have come, ns: the plant's timer may be late.
const STATE_NS: u64 = 500_000;
/// How long for what answers a state that has come, ns.
const ANSWER_NS: u64 = 150_000;
/// Most periods that are foreseen.
const FAR: i64 = 4;

/// The last state's tick, and when it was due and published, ns.
#[derive(Clone, Copy, Debug)]
struct Last {
    tick: i64,
    due: u64,
    stamp: u64,
}

/// What the last state tells of the next ones.
#[derive(Clone, Copy, Debug)]
pub struct ArrivalPredictor {
    before_ns: u64,
    last: Option<Last>,
}

impl ArrivalPredictor {
    /// How long a rehearsal may take, ns: going through a tick's work beforehand, so that it is in the caches when it counts.
    const WARM_UP_NS: u64 = 25_000;

    /// Looks out from `before_us` before a state is due; `None` if that is zero: then everything is waited for asleep.
    #[must_use]
    pub fn new(before_us: u32) -> Option<Self> {
        (before_us > 0).then(|| Self { before_ns: u64::from(before_us) * 1000, last: None })
    }

    /// Learns from a state. What it says of its time is believed as far as it can be true `now_ns`.
    pub fn observe(&mut self, state: &State, now_ns: u64) {
        let stamp = state.stamp_ns.clamp(now_ns.saturating_sub(PERIOD_NS), now_ns);
        // Whole periods have slipped, and are not caught up.
        let due = stamp.saturating_sub(state.wake_lateness_ns % PERIOD_NS);
        self.last = Some(Last { tick: state.tick, due, stamp });
    }

    /// From when until when a tick's state is looked out for, or its answer if that state was the last; `None` if nobody knows.
    fn window(&self, tick: i64) -> Option<(u64, u64)> {
        let last = self.last?;
        let ahead = tick.checked_sub(last.tick).filter(|ahead| (0..=FAR).contains(ahead))?;
        if ahead == 0 {
            return Some((last.stamp, last.stamp.saturating_add(ANSWER_NS)));
        }
        let due = last.due.saturating_add(ahead as u64 * PERIOD_NS);
        Some((due.saturating_sub(self.before_ns), due.saturating_add(STATE_NS)))
    }

    /// Sleeps until shortly before what a tick brings is due. Says whether there is time left until then for a rehearsal; `false` at
    /// once if nothing is foreseen or it is late already.
    pub fn sleep_until_window(&self, tick: i64) -> bool {
        // What answers a state that is here is due at once.
        let Some((begin, _)) = self.window(tick).filter(|_| self.last.is_some_and(|last| last.tick < tick)) else { return false };
        if clock::now_ns() < begin {
            clock::sleep_until(begin);
        }
        let now = clock::now_ns();
        // Not if a signal ended the sleep.
        now >= begin && now.saturating_add(Self::WARM_UP_NS) < begin.saturating_add(self.before_ns)
    }

    /// Waits for what a tick brings: asleep until shortly before, and then looking at the inputs, not beyond `limit_ns`. Says whether
    /// anything was sent to one of them; `false` at once if that time is over, and if nothing is foreseen.
    pub fn watch(&self, inputs: &[&dyn Wakes], tick: i64, limit_ns: u64) -> bool {
        let Some((begin, end)) = self.window(tick) else { return false };
        let end = end.min(limit_ns);
        let now = clock::now_ns();
        if now >= end || begin >= end {
            return false;
        }
        if now < begin {
            clock::sleep_until(begin);
        }
        // Not if a signal ended the sleep.
        clock::now_ns() >= begin && watch(inputs, end)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::doorbell::{Doorbell, DoorbellId, DoorbellPage, Listener};

    fn state(tick: i64, stamp_ns: u64, wake_lateness_ns: u64) -> State {
        State { tick, stamp_ns, wake_lateness_ns, ..State::default() }
    }

    #[test]
    fn the_next_is_due_a_period_after_the_last_one_was() {
        let mut predictor = ArrivalPredictor::new(50).unwrap();
        assert_eq!(predictor.window(0), None, "nothing is known before the first");
        predictor.observe(&state(7, 10_030_000, 25_000), 10_040_000);
        assert_eq!(predictor.window(7), Some((10_030_000, 10_180_000)), "the answer");
        assert_eq!(predictor.window(8), Some((10_955_000, 11_505_000)));
        assert_eq!(predictor.window(10), Some((12_955_000, 13_505_000)));
        assert_eq!(predictor.window(6), None);
        assert_eq!(predictor.window(7 + FAR + 1), None);
        assert_eq!(predictor.window(i64::MIN), None);
        assert!(ArrivalPredictor::new(0).is_none());
    }

    #[test]
    fn a_period_that_slipped_is_not_caught_up() {
        let mut predictor = ArrivalPredictor::new(50).unwrap();
        // Due at 10.0 ms, the timer came at 12.3: the next is due at 13.0.
        predictor.observe(&state(7, 12_300_000, 2_300_000), 12_300_000);
        assert_eq!(predictor.window(8), Some((12_950_000, 13_500_000)));
    }

    #[test]
    fn a_stamp_that_cannot_be_true_is_not_believed() {
        let mut predictor = ArrivalPredictor::new(50).unwrap();
        for (stamp, lateness) in [(u64::MAX, 0), (0, 0), (u64::MAX, u64::MAX), (20_000_000, 999_999)] {
            predictor.observe(&state(1, stamp, lateness), 20_000_000);
            let (begin, end) = predictor.window(2).unwrap();
            assert!(begin >= 17_000_000 && end <= 21_500_000, "{begin} {end}");
        }
    }

    #[test]
    fn there_is_time_for_a_rehearsal_before_a_state_and_not_after() {
        let mut predictor = ArrivalPredictor::new(500).unwrap();
        assert!(!predictor.sleep_until_window(1), "nothing is foreseen");
        let now = clock::now_ns();
        predictor.observe(&state(0, now, 0), now);
        assert!(!predictor.sleep_until_window(0), "it is here");
        assert!(!predictor.sleep_until_window(FAR + 1), "too far");
        // A machine that is busy may wake up too late.
        let early = predictor.sleep_until_window(1);
        let woken = clock::now_ns();
        assert!(woken >= now + PERIOD_NS - 500_000, "it slept until then");
        assert!(early || woken >= now + PERIOD_NS - ArrivalPredictor::WARM_UP_NS - 200_000, "there was time");
        clock::sleep_until(now + PERIOD_NS);
        assert!(!predictor.sleep_until_window(1), "it is due");
        let mut with_short_timeouts = ArrivalPredictor::new(20).unwrap();
        with_short_timeouts.observe(&state(0, clock::now_ns(), 0), clock::now_ns());
        assert!(!with_short_timeouts.sleep_until_window(1), "no time for it at all");
    }

    #[test]
    fn it_looks_until_there_is_something_or_the_time_is_up() {
        let folder = tempfile::tempdir().unwrap();
        let doorbells = DoorbellPage::open(folder.path().to_str().unwrap()).unwrap();
        let listener = Listener::new(&doorbells, DoorbellId(0));
        let doorbell = Doorbell::new(&doorbells, DoorbellId(0));
        let mut predictor = ArrivalPredictor::new(50).unwrap();
        assert!(!predictor.watch(&[&listener], 0, u64::MAX), "nothing is foreseen");
        let now = clock::now_ns();
        predictor.observe(&state(0, now, 0), now);
        doorbell.notify();
        assert!(!predictor.watch(&[&listener], 2, now), "the limit is over");
        assert!(crate::wait(&[&listener], core::time::Duration::ZERO).unwrap(), "so what was sent has not been looked for");
        assert!(!predictor.watch(&[&listener], 2, u64::MAX), "nothing was sent");
        assert!(clock::now_ns() >= now + 2 * PERIOD_NS + STATE_NS);
        doorbell.notify();
        assert!(!predictor.watch(&[&listener], 1, u64::MAX), "its time is over");
        assert!(crate::wait(&[&listener], core::time::Duration::ZERO).unwrap(), "and what was sent can still be waited for");
        doorbell.notify();
        let now = clock::now_ns();
        predictor.observe(&state(3, now, 0), now);
        assert!(predictor.watch(&[&listener], 3, u64::MAX) || clock::now_ns() >= now + ANSWER_NS);
        assert!(!doorbell.is_polled());
    }
}
