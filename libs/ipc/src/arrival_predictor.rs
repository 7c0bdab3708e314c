//! Arrival predictor: when the next state is due, so that a thread can busy-poll for it instead of sleeping.
//!
//! Waking a thread costs two system calls and a context switch. The plant publishes states by an absolute timer, so
//! each state predicts the next. The answering thread wakes some microseconds before that, and polls the doorbell
//! ([`poll`]). For a state that is later than the busy-poll window it sleeps, as for everything else.

use crate::clock;
use crate::doorbell::{Wakes, poll};
use hapfic_messages::{PERIOD_NS, State};

/// Busy-poll time for a state that is overdue [ns]: the plant's timer may be late.
const STATE_NS: u64 = 500_000;
/// Busy-poll time for the answer to a state that has come [ns].
const ANSWER_NS: u64 = 150_000;
/// Longest prediction [periods].
const HORIZON: i64 = 4;

/// Last state: its tick, and when it was due and published [ns].
#[derive(Clone, Copy, Debug)]
struct LastArrival {
    tick: i64,
    due: u64,
    stamp: u64,
}

/// Predictor of state arrivals from the last state.
#[derive(Clone, Copy, Debug)]
pub struct ArrivalPredictor {
    before_ns: u64,
    last: Option<LastArrival>,
}

impl ArrivalPredictor {
    /// Time for a cache warm-up [ns]: a dry run of a tick's work.
    const WARM_UP_NS: u64 = 25_000;

    /// Predictor whose busy-poll window opens `before_us` before a state is due; `None` if that is zero: no busy-poll.
    #[must_use]
    pub fn new(before_us: u32) -> Option<Self> {
        (before_us > 0).then(|| Self { before_ns: u64::from(before_us) * 1000, last: None })
    }

    /// Takes the times of a state, bounded to what is plausible at `now_ns`.
    pub fn observe(&mut self, state: &State, now_ns: u64) {
        let stamp = state.stamp_ns.clamp(now_ns.saturating_sub(PERIOD_NS), now_ns);
        // Slipped periods are not made up for.
        let due = stamp.saturating_sub(state.wake_lateness_ns % PERIOD_NS);
        self.last = Some(LastArrival { tick: state.tick, due, stamp });
    }

    /// Busy-poll window of a tick's state, or of its answer if that state was the last [ns]; `None` without a
    /// prediction.
    fn window(&self, tick: i64) -> Option<(u64, u64)> {
        let last = self.last?;
        let ahead = tick.checked_sub(last.tick).filter(|ahead| (0..=HORIZON).contains(ahead))?;
        if ahead == 0 {
            return Some((last.stamp, last.stamp.saturating_add(ANSWER_NS)));
        }
        let due = last.due.saturating_add(ahead as u64 * PERIOD_NS);
        Some((due.saturating_sub(self.before_ns), due.saturating_add(STATE_NS)))
    }

    /// Sleeps until the busy-poll window of a tick's state opens. Returns whether there is time for a cache warm-up;
    /// `false` immediately without a prediction, or if the window is already open.
    pub fn sleep_until_window(&self, tick: i64) -> bool {
        self.sleep_until_window_on(&MonotonicClock, tick)
    }

    fn sleep_until_window_on(&self, clock: &impl WaitClock, tick: i64) -> bool {
        // The answer to a state that is here is due immediately.
        let Some((begin, _)) = self.window(tick).filter(|_| self.last.is_some_and(|last| last.tick < tick)) else { return false };
        if clock.now_ns() < begin {
            clock.sleep_until(begin);
        }
        let now = clock.now_ns();
        // Not if a signal ended the sleep.
        now >= begin && now.saturating_add(Self::WARM_UP_NS) < begin.saturating_add(self.before_ns)
    }

    /// Waits for the arrival of a tick: sleeps until its busy-poll window opens, then polls the inputs, up to
    /// `limit_ns`. Returns whether any of them was notified; `false` immediately after the window, and without a
    /// prediction.
    pub fn poll(&self, inputs: &[&dyn Wakes], tick: i64, limit_ns: u64) -> bool {
        self.poll_on(&MonotonicClock, tick, limit_ns, |end| poll(inputs, end))
    }

    fn poll_on(&self, clock: &impl WaitClock, tick: i64, limit_ns: u64, poll_until: impl FnOnce(u64) -> bool) -> bool {
        let Some((begin, end)) = self.window(tick) else { return false };
        let end = end.min(limit_ns);
        let now = clock.now_ns();
        if now >= end || begin >= end {
            return false;
        }
        if now < begin {
            clock.sleep_until(begin);
        }
        // Not if a signal ended the sleep.
        clock.now_ns() >= begin && poll_until(end)
    }
}

/// Clock of a wait.
trait WaitClock {
    fn now_ns(&self) -> u64;
    fn sleep_until(&self, deadline_ns: u64);
}

/// `CLOCK_MONOTONIC`.
struct MonotonicClock;

impl WaitClock for MonotonicClock {
    fn now_ns(&self) -> u64 {
        clock::now_ns()
    }

    fn sleep_until(&self, deadline_ns: u64) {
        clock::sleep_until(deadline_ns);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::doorbell::{Doorbell, DoorbellId, DoorbellPage, Listener};
    use core::cell::Cell;

    fn state(tick: i64, stamp_ns: u64, wake_lateness_ns: u64) -> State {
        State { tick, stamp_ns, wake_lateness_ns, ..State::default() }
    }

    #[test]
    fn window_next_state_starts_period_after_last() {
        let mut predictor = ArrivalPredictor::new(50).unwrap();
        assert_eq!(predictor.window(0), None, "nothing is known before the first");
        predictor.observe(&state(7, 10_030_000, 25_000), 10_040_000);
        assert_eq!(predictor.window(7), Some((10_030_000, 10_180_000)), "the answer");
        assert_eq!(predictor.window(8), Some((10_955_000, 11_505_000)));
        assert_eq!(predictor.window(10), Some((12_955_000, 13_505_000)));
        assert_eq!(predictor.window(6), None);
        assert_eq!(predictor.window(7 + HORIZON + 1), None);
        assert_eq!(predictor.window(i64::MIN), None);
        assert!(ArrivalPredictor::new(0).is_none());
    }

    #[test]
    fn window_slipped_period_keeps_timer_phase() {
        let mut predictor = ArrivalPredictor::new(50).unwrap();
        // Due at 10.0 ms, the timer came at 12.3: the next is due at 13.0.
        predictor.observe(&state(7, 12_300_000, 2_300_000), 12_300_000);
        assert_eq!(predictor.window(8), Some((12_950_000, 13_500_000)));
    }

    #[test]
    fn observe_implausible_stamp_bounded() {
        let mut predictor = ArrivalPredictor::new(50).unwrap();
        for (stamp, lateness) in [(u64::MAX, 0), (0, 0), (u64::MAX, u64::MAX), (20_000_000, 999_999)] {
            predictor.observe(&state(1, stamp, lateness), 20_000_000);
            let (begin, end) = predictor.window(2).unwrap();
            assert!(begin >= 17_000_000 && end <= 21_500_000, "{begin} {end}");
        }
    }

    /// Clock of a test: a sleep takes until its end and `late_ns` more, or is ended by a signal.
    struct TestClock {
        now_ns: Cell<u64>,
        late_ns: u64,
        signal: bool,
    }

    impl TestClock {
        fn at(now_ns: u64) -> Self {
            Self { now_ns: Cell::new(now_ns), late_ns: 0, signal: false }
        }
    }

    impl WaitClock for TestClock {
        fn now_ns(&self) -> u64 {
            self.now_ns.get()
        }

        fn sleep_until(&self, deadline_ns: u64) {
            self.now_ns.set(if self.signal { self.now_ns.get() + 1 } else { deadline_ns + self.late_ns });
        }
    }

    /// Predictor whose window opens 50 us before a state; state 0 was published at 10 ms, on time.
    fn predictor() -> ArrivalPredictor {
        let mut predictor = ArrivalPredictor::new(50).unwrap();
        predictor.observe(&state(0, 10_000_000, 0), 10_000_000);
        predictor
    }

    #[test]
    fn sleep_until_window_ends_at_window_with_time_for_warm_up() {
        let sleep = |clock: &TestClock, tick: i64| predictor().sleep_until_window_on(clock, tick);
        let clock = TestClock::at(10_100_000);
        assert!(sleep(&clock, 1));
        assert_eq!(clock.now_ns(), 10_950_000);
        assert!(!sleep(&TestClock { late_ns: 25_000, ..TestClock::at(10_100_000) }, 1), "woken too late for a warm-up");
        assert!(sleep(&TestClock { late_ns: 24_999, ..TestClock::at(10_100_000) }, 1));
        assert!(!sleep(&TestClock { signal: true, ..TestClock::at(10_100_000) }, 1), "woken by a signal");
        for (now, tick) in [(10_100_000, 0), (10_100_000, HORIZON + 1), (10_980_000, 1)] {
            let clock = TestClock::at(now);
            assert!(!sleep(&clock, tick), "tick {tick} at {now} ns");
            assert_eq!(clock.now_ns(), now, "no sleep");
        }
        assert!(!ArrivalPredictor::new(50).unwrap().sleep_until_window_on(&TestClock::at(0), 1), "no prediction");
    }

    #[test]
    fn poll_lasts_from_window_begin_to_its_end_or_limit() {
        let ends = |clock: &TestClock, tick: i64, limit: u64| {
            let mut polled = None;
            let notified = predictor().poll_on(clock, tick, limit, |end| {
                polled = Some((clock.now_ns(), end));
                true
            });
            assert_eq!(notified, polled.is_some());
            polled
        };
        assert_eq!(ends(&TestClock::at(10_100_000), 2, u64::MAX), Some((11_950_000, 12_500_000)));
        assert_eq!(ends(&TestClock::at(12_100_000), 2, u64::MAX), Some((12_100_000, 12_500_000)), "inside the window");
        assert_eq!(ends(&TestClock::at(10_100_000), 2, 12_000_000), Some((11_950_000, 12_000_000)), "up to the limit");
        assert_eq!(ends(&TestClock::at(10_020_000), 0, u64::MAX), Some((10_020_000, 10_150_000)), "the answer");
        assert_eq!(ends(&TestClock::at(12_500_000), 2, u64::MAX), None, "after the window");
        assert_eq!(ends(&TestClock::at(10_100_000), 2, 11_950_000), None, "the limit is before the window");
        assert_eq!(ends(&TestClock { signal: true, ..TestClock::at(10_100_000) }, 2, u64::MAX), None, "woken by a signal");
        let never = |_| panic!("polled without a prediction");
        assert!(!ArrivalPredictor::new(50).unwrap().poll_on(&TestClock::at(0), 0, u64::MAX, never));
    }

    #[test]
    fn poll_pending_notification_is_found_and_none_is_lost() {
        let folder = tempfile::tempdir().unwrap();
        let doorbells = DoorbellPage::open(folder.path().to_str().unwrap()).unwrap();
        let listener = Listener::new(&doorbells, DoorbellId(0));
        let doorbell = Doorbell::new(&doorbells, DoorbellId(0));
        let mut predictor = ArrivalPredictor::new(50).unwrap();
        let now = clock::now_ns();
        predictor.observe(&state(0, now, 0), now);
        doorbell.notify();
        assert!(!predictor.poll(&[&listener], 2, now), "the limit is over");
        assert!(crate::wait(&[&listener], core::time::Duration::ZERO).unwrap(), "the notification is still pending");
        assert!(!predictor.poll(&[&listener], 2, u64::MAX), "no notification");
        assert!(!doorbell.is_polled());
    }
}
