//! Wake-up latency: time from waking a thread by a futex until it runs.

use anyhow::{Result, bail};
use hapfic_ipc::clock;
use hapfic_ipc::realtime::{SchedRequest, apply_to_current_thread};
use hapfic_log::metrics::Latencies;
use hapfic_messages::PERIOD_NS;
use rustix::thread::futex::{self, Flags};
use rustix::time::Timespec;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

/// Longest wait before a thread checks for the end.
const POLL_INTERVAL: Timespec = Timespec { tv_sec: 0, tv_nsec: 100_000_000 };
/// Time after which a thread that does not run fails the measurement [ns].
const TIMEOUT_NS: u64 = 10_000_000_000;

/// Pair of threads: one wakes, the other responds.
#[derive(Debug, Default)]
pub(super) struct WakeupPair {
    requests: AtomicU32,
    responses: AtomicU32,
    woke_ns: AtomicU64,
    closed: AtomicBool,
}

impl WakeupPair {
    /// Responds to each wake-up until [`close`](Self::close).
    pub(super) fn respond(&self, sched: SchedRequest) {
        let _ = apply_to_current_thread(sched);
        let mut seen = 0;
        loop {
            while self.requests.load(Ordering::Acquire) == seen {
                if self.closed.load(Ordering::Acquire) {
                    return;
                }
                // Woken, interrupted or timed out: the number decides.
                let _ = futex::wait(&self.requests, Flags::PRIVATE, seen, Some(&POLL_INTERVAL));
            }
            self.woke_ns.store(clock::now_ns(), Ordering::Relaxed);
            seen = self.requests.load(Ordering::Acquire);
            self.responses.store(seen, Ordering::Release);
            let _ = futex::wake(&self.responses, Flags::PRIVATE, 1);
        }
    }

    /// Wakes the other thread, waits for its response, and returns its wake-up latency [ns].
    fn wake(&self) -> Result<u64> {
        let before = self.requests.load(Ordering::Relaxed);
        let next = before.wrapping_add(1);
        let sent = clock::now_ns();
        self.requests.store(next, Ordering::Release);
        let _ = futex::wake(&self.requests, Flags::PRIVATE, 1);
        while self.responses.load(Ordering::Acquire) != next {
            let _ = futex::wait(&self.responses, Flags::PRIVATE, before, Some(&POLL_INTERVAL));
            if clock::now_ns().saturating_sub(sent) > TIMEOUT_NS {
                bail!("a woken thread has not run for 10 s, expected microseconds; does a real-time program occupy its core?");
            }
        }
        Ok(self.woke_ns.load(Ordering::Relaxed).saturating_sub(sent))
    }

    /// Ends the responding thread.
    pub(super) fn close(&self) {
        self.closed.store(true, Ordering::Release);
        let _ = futex::wake(&self.requests, Flags::PRIVATE, 1);
    }
}

/// Pair of threads, and its phase in each period.
pub(super) struct WakeupProbe<'a> {
    /// The pair.
    pub(super) pair: &'a WakeupPair,
    /// Phase in the period [ns].
    pub(super) phase_ns: u64,
}

/// Measures each pair once a period from one instant to another; skips missed periods.
pub(super) fn measure_wakeups(probes: &[WakeupProbe<'_>], from_ns: u64, to_ns: u64) -> Result<Vec<Latencies>> {
    let mut all = vec![Latencies::default(); probes.len()];
    let mut period = from_ns;
    while period < to_ns {
        for (probe, latencies) in probes.iter().zip(&mut all) {
            let due = period + probe.phase_ns;
            while clock::now_ns() < due {
                clock::sleep_until(due);
            }
            latencies.record(probe.pair.wake()?);
        }
        let elapsed = clock::now_ns().saturating_sub(period) / PERIOD_NS;
        period += PERIOD_NS * elapsed.max(1);
    }
    Ok(all)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn measure_wakeups_each_request_has_one_response() {
        let (pair, sched) = (WakeupPair::default(), SchedRequest { priority: 1, core: None });
        std::thread::scope(|scope| {
            scope.spawn(|| pair.respond(sched));
            let from = clock::now_ns();
            let found = measure_wakeups(&[WakeupProbe { pair: &pair, phase_ns: 0 }], from, from + 50 * PERIOD_NS);
            pair.close();
            let q = found.unwrap()[0].quantiles_us().unwrap();
            assert!(q.p50 <= q.max);
        });
        let requests = pair.requests.load(Ordering::Relaxed);
        assert!((1..=50).contains(&requests), "{requests} requests in 50 periods");
        assert_eq!(pair.responses.load(Ordering::Relaxed), requests);
    }
}
