//! Deadline timer: a time-out that costs the waiting thread no system call.
//!
//! A sleep with a time-out makes the kernel set a timer before it, and cancel it afterwards. In a virtual machine each
//! is an exit to the host, some 10 us, twice in every hop. A [`DeadlineTimer`] is a helper thread on another core. It
//! wakes once a period, checks whether the deadline is still armed, and only then notifies the owner's doorbell. The
//! owner waits without a time-out; to arm the deadline it stores a number.

use crate::clock;
use crate::doorbell::Doorbell;
use crate::realtime::{self, SchedRequest};
use core::sync::atomic::{AtomicBool, Ordering};
use hapfic_sync::DeadlineWord;
use std::sync::Arc;
use std::thread::JoinHandle;

#[derive(Debug, Default)]
struct TimerState {
    deadline: DeadlineWord,
    stop: AtomicBool,
}

/// Helper thread that notifies a doorbell at a deadline, unless it is disarmed before.
#[derive(Debug)]
pub struct DeadlineTimer {
    shared: Arc<TimerState>,
    thread: Option<JoinHandle<()>>,
}

impl DeadlineTimer {
    /// Starts the helper thread. It checks every `period_ns`, at the phase of the deadline that was armed last.
    ///
    /// A deadline less than a period ahead may fire up to a period late if it has another phase than the previous one.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn start(name: &str, doorbell: Doorbell, period_ns: u64, request: Option<SchedRequest>) -> std::io::Result<Self> {
        let shared = Arc::new(TimerState::default());
        let theirs = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name(name.to_owned()).stack_size(realtime::SMALL_STACK).spawn(move || {
            if let Some(request) = request {
                // Without privileges it fires a little later.
                let _ = realtime::apply_without_heap(request);
            }
            let mut next = clock::now_ns();
            while !theirs.stop.load(Ordering::Relaxed) {
                clock::sleep_until(next);
                let now = clock::now_ns();
                let (when, fired) = theirs.deadline.fire_if_due(now);
                if fired {
                    doorbell.notify();
                }
                next = next_check(when, now, period_ns);
            }
        })?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// Arms the deadline at a time of the monotonic clock [ns], in place of the previous one.
    pub fn set(&self, when_ns: u64) {
        self.shared.deadline.arm(when_ns);
    }

    /// Disarms the deadline; its notification may be in flight.
    pub fn clear(&self) {
        self.shared.deadline.disarm();
    }
}

impl Drop for DeadlineTimer {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // Its panic has been printed.
            let _ = thread.join();
        }
    }
}

/// First time after `now` that is whole periods away from `when`.
fn next_check(when: u64, now: u64, period: u64) -> u64 {
    if when > now {
        // At most a period ahead: the deadline may be armed again meanwhile.
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
    fn next_check_armed_deadline_keeps_phase() {
        for (when, now, next) in
            [(10, 0, 2), (10, 1, 2), (10, 2, 6), (10, 9, 10), (10, 10, 14), (10, 13, 14), (10, 14, 18), (0, 5, 8)]
        {
            assert_eq!(next_check(when, now, 4), next, "set for {when}, it is {now}");
        }
    }

    #[test]
    fn deadline_timer_fires_once_unless_cleared() {
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
        assert!(!wait(&[&listener], Duration::from_millis(20)).unwrap(), "it fires once");
        deadline_timer.set(clock::now_ns() + 1000 * PERIOD);
        deadline_timer.clear();
        assert!(!deadline_timer.shared.deadline.is_armed());
        drop(deadline_timer);
        assert!(!wait(&[&listener], Duration::from_millis(5)).unwrap());
    }
}
