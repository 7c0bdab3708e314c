//! A deadline that costs nothing while it is kept.
//!
//! Whoever sleeps with a time-out has the kernel set a timer before he sleeps, and take it back when he is woken in time. In a
//! virtual machine each is an exit to the host, some 10 us, twice in every hop that is waited for so. An [`DeadlineTimer`] is a thread on
//! another core that wakes once a period, when the owner would have to be woken, looks whether it still waits, and only then rings its
//! doorbell. The owner waits without a time-out; to set the deadline_timer it stores a number.

use crate::clock;
use crate::doorbell::Doorbell;
use crate::realtime::{self, SchedRequest};
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::Arc;
use std::thread::JoinHandle;

#[derive(Debug, Default)]
struct Shared {
    /// Twice the time to ring at, ns of the monotonic clock, plus 1 if it is to be rung then.
    when: AtomicU64,
    stop: AtomicBool,
}

/// Rings a doorbell at a time, unless it is put off before.
#[derive(Debug)]
pub struct DeadlineTimer {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl DeadlineTimer {
    /// Starts the thread. It looks once every `period_ns` at the phase of the time that was set last: a time that is set less than a
    /// period ahead, at another phase than the ones before, may be rung up to a period late.
    ///
    /// # Errors
    /// If there is no thread to be had.
    pub fn start(name: &str, doorbell: Doorbell, period_ns: u64, wish: Option<SchedRequest>) -> std::io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let theirs = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name(name.to_owned()).stack_size(realtime::SMALL_STACK).spawn(move || {
            if let Some(wish) = wish {
                // Without privileges it rings a little later.
                let _ = realtime::apply_without_heap(wish);
            }
            let mut next = clock::now_ns();
            while !theirs.stop.load(Ordering::Relaxed) {
                clock::sleep_until(next);
                let now = clock::now_ns();
                let set = theirs.when.load(Ordering::Acquire);
                let when = set / 2;
                if set % 2 == 1
                    && when <= now
                    && theirs.when.compare_exchange(set, when * 2, Ordering::AcqRel, Ordering::Relaxed).is_ok()
                {
                    doorbell.notify();
                }
                next = next_look(when, now, period_ns);
            }
        })?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// Has it ring at a time of the monotonic clock, ns, instead of what was set before.
    pub fn set(&self, when_ns: u64) {
        self.shared.when.store(when_ns * 2 + 1, Ordering::Release);
    }

    /// Has it not ring; a ring may be on its way.
    pub fn clear(&self) {
        self.shared.when.fetch_and(!1, Ordering::AcqRel);
    }
}

impl Drop for DeadlineTimer {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // It has nothing to say.
            let _ = thread.join();
        }
    }
}

/// The first time after `now` that is whole periods away from `when`.
fn next_look(when: u64, now: u64, period: u64) -> u64 {
    if when > now {
        // Not further ahead than a period: it may be set anew meanwhile.
        when - (when - now - 1) / period * period
    } else {
        now + period - (now - when) % period
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::doorbell::{DoorbellId, DoorbellPage, Listener, wait};
    use core::time::Duration;

    const PERIOD: u64 = 1_000_000;

    #[test]
    fn it_looks_at_the_phase_of_what_was_set_and_within_a_period() {
        for (when, now, next) in
            [(10, 0, 2), (10, 1, 2), (10, 2, 6), (10, 9, 10), (10, 10, 14), (10, 13, 14), (10, 14, 18), (0, 5, 8)]
        {
            assert_eq!(next_look(when, now, 4), next, "set for {when}, it is {now}");
        }
    }

    #[test]
    fn it_rings_when_set_and_not_when_cleared() {
        let folder = tempfile::tempdir().unwrap();
        let doorbells = DoorbellPage::open(folder.path().to_str().unwrap()).unwrap();
        let listener = Listener::new(&doorbells, DoorbellId(0));
        let deadline_timer =
            DeadlineTimer::start("test-deadline_timer", Doorbell::new(&doorbells, DoorbellId(0)), PERIOD, None).unwrap();
        for _ in 0..5 {
            let when = clock::now_ns() + 3 * PERIOD;
            deadline_timer.set(when);
            assert!(wait(&[&listener], Duration::MAX).unwrap());
            assert!(clock::now_ns() >= when);
        }
        assert!(!wait(&[&listener], Duration::from_millis(20)).unwrap(), "it rings once");
        deadline_timer.set(clock::now_ns() + 1000 * PERIOD);
        deadline_timer.clear();
        assert_eq!(deadline_timer.shared.when.load(Ordering::Relaxed) % 2, 0);
        drop(deadline_timer);
        assert!(!wait(&[&listener], Duration::from_millis(5)).unwrap());
    }
}
