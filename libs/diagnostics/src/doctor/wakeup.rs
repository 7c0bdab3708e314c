//! How long a thread takes to run once another one has woken it, with nothing but a futex between them.

use anyhow::{Result, bail};
use hapfic_ipc::clock;
use hapfic_ipc::realtime::{SchedRequest, apply_to_current_thread};
use hapfic_log::metrics::Latencies;
use hapfic_messages::PERIOD_NS;
use rustix::thread::futex::{self, Flags};
use rustix::time::Timespec;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

/// How long to wait between two looks whether it is over.
const POLL_INTERVAL: Timespec = Timespec { tv_sec: 0, tv_nsec: 100_000_000 };
/// How long a thread that was woken may take, ns; longer and the measurement is given up.
const TIMEOUT_NS: u64 = 10_000_000_000;

/// A line between the one who wakes and the one who is woken.
#[derive(Debug, Default)]
pub(super) struct Line {
    asked: AtomicU32,
    answered: AtomicU32,
    woke_ns: AtomicU64,
    over: AtomicBool,
}

impl Line {
    /// The one who is woken: until [`close`](Self::close).
    pub(super) fn answer(&self, sched: SchedRequest) {
        let _ = apply_to_current_thread(sched);
        let mut seen = 0;
        loop {
            while self.asked.load(Ordering::Acquire) == seen {
                if self.over.load(Ordering::Acquire) {
                    return;
                }
                // Woken, interrupted or timed out: the number says.
                let _ = futex::wait(&self.asked, Flags::PRIVATE, seen, Some(&POLL_INTERVAL));
            }
            self.woke_ns.store(clock::now_ns(), Ordering::Relaxed);
            seen = self.asked.load(Ordering::Acquire);
            self.answered.store(seen, Ordering::Release);
            let _ = futex::wake(&self.answered, Flags::PRIVATE, 1);
        }
    }

    /// Wakes the other, waits for its answer, and returns how long it took to run, ns.
    fn ask(&self) -> Result<u64> {
        let before = self.asked.load(Ordering::Relaxed);
        let next = before.wrapping_add(1);
        let sent = clock::now_ns();
        self.asked.store(next, Ordering::Release);
        let _ = futex::wake(&self.asked, Flags::PRIVATE, 1);
        while self.answered.load(Ordering::Acquire) != next {
            let _ = futex::wait(&self.answered, Flags::PRIVATE, before, Some(&POLL_INTERVAL));
            if clock::now_ns().saturating_sub(sent) > TIMEOUT_NS {
                bail!(
                    "a thread that was woken did not run for 10 s, expected microseconds; is a real-time program keeping its core busy?"
                );
            }
        }
        Ok(self.woke_ns.load(Ordering::Relaxed).saturating_sub(sent))
    }

    /// Ends the one who is woken.
    pub(super) fn close(&self) {
        self.over.store(true, Ordering::Release);
        let _ = futex::wake(&self.asked, Flags::PRIVATE, 1);
    }
}

/// A line, and when in each period it is used.
pub(super) struct Turn<'a> {
    /// The line.
    pub(super) line: &'a Line,
    /// When in the period, ns.
    pub(super) phase_ns: u64,
}

/// Uses each line once a period from one instant to another; what comes late is left out, not caught up.
pub(super) fn ask_all(turns: &[Turn<'_>], from_ns: u64, to_ns: u64) -> Result<Vec<Latencies>> {
    let mut all = vec![Latencies::default(); turns.len()];
    let mut period = from_ns;
    while period < to_ns {
        for (turn, distribution) in turns.iter().zip(&mut all) {
            let due = period + turn.phase_ns;
            while clock::now_ns() < due {
                clock::sleep_until(due);
            }
            distribution.record(turn.line.ask()?);
        }
        let gone = clock::now_ns().saturating_sub(period) / PERIOD_NS;
        period += PERIOD_NS * gone.max(1);
    }
    Ok(all)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_question_is_answered_once() {
        let (line, sched) = (Line::default(), SchedRequest { priority: 1, core: None });
        std::thread::scope(|scope| {
            scope.spawn(|| line.answer(sched));
            let from = clock::now_ns();
            let found = ask_all(&[Turn { line: &line, phase_ns: 0 }], from, from + 50 * PERIOD_NS);
            line.close();
            let q = found.unwrap()[0].quantiles_us().unwrap();
            assert!(q.p50 <= q.max);
        });
        let asked = line.asked.load(Ordering::Relaxed);
        assert!((1..=50).contains(&asked), "{asked} questions in 50 periods");
        assert_eq!(line.answered.load(Ordering::Relaxed), asked);
    }
}
