//! What the supervisor's threads tell each other: plain atomics, so that the gate never waits for anybody.

use hapfic_ipc::clock;
use hapfic_messages::{Detector, Phase, Process, Timing};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU32, AtomicU64, Ordering};

/// The recorder listens every ten milliseconds; a gap longer than this, ns, counts as no more than it.
const ATTENTION_NS: u64 = 20_000_000;

/// Signs of life of one process.
#[derive(Debug, Default)]
pub struct Heartbeat {
    /// When it was last heard of; zero: never.
    last_ns: AtomicU64,
    /// How long the recorder had listened by then.
    last_at: AtomicU64,
    /// Which start of the process it is (upper half), and code of its phase plus one (lower half; zero: never heard of). One word:
    /// what a dead process said last must not be taken for its successor's.
    phase: AtomicU64,
    /// Real-time privileges it has.
    realtime: AtomicU32,
    /// Messages it has rejected.
    rejected: AtomicU32,
    /// Its last tick.
    tick: AtomicI64,
    /// How often it could not meet somebody.
    failed_connections: AtomicU32,
}

impl Heartbeat {
    /// Its phase, once heard of.
    #[must_use]
    pub fn phase(&self) -> Option<Phase> {
        (self.phase.load(Ordering::Acquire) as u32).checked_sub(1).and_then(Phase::from_code)
    }

    /// When it was last heard of.
    fn last_ns(&self) -> Option<u64> {
        Some(self.last_ns.load(Ordering::Relaxed)).filter(|heard| *heard > 0)
    }

    /// The tick it reported of last.
    #[must_use]
    pub fn tick(&self) -> i64 {
        self.tick.load(Ordering::Relaxed)
    }

    /// How long ago it was heard of, ns.
    #[must_use]
    pub fn age_ns(&self) -> Option<u64> {
        self.last_ns().map(|heard| clock::now_ns().saturating_sub(heard))
    }

    /// Messages it has rejected since it started.
    #[must_use]
    pub fn rejected(&self) -> u32 {
        self.rejected.load(Ordering::Relaxed)
    }

    /// How often it could not meet somebody who had joined, since it started.
    #[must_use]
    pub fn failed_connections(&self) -> u32 {
        self.failed_connections.load(Ordering::Relaxed)
    }

    /// Real-time privileges it has, bits of [`hapfic_ipc::realtime::SchedGrants`].
    #[must_use]
    pub fn realtime(&self) -> u32 {
        self.realtime.load(Ordering::Relaxed)
    }
}

/// Latencies that count as recent: one a tick, for a second.
const RECENT: usize = 1000;

/// The last latencies from state to command, us.
#[derive(Debug)]
pub struct Latencies {
    us: [AtomicU32; RECENT],
    count: AtomicU64,
}

impl Default for Latencies {
    fn default() -> Self {
        Self { us: [const { AtomicU32::new(0) }; RECENT], count: AtomicU64::new(0) }
    }
}

impl Latencies {
    /// By one thread only.
    fn push(&self, ns: u64) {
        let count = self.count.load(Ordering::Relaxed);
        self.us[count as usize % RECENT].store(u32::try_from(ns / 1000).unwrap_or(u32::MAX), Ordering::Relaxed);
        self.count.store(count + 1, Ordering::Release);
    }

    /// Those there are, in ascending order.
    #[must_use]
    pub fn sorted(&self) -> Vec<u32> {
        let count = usize::try_from(self.count.load(Ordering::Acquire)).unwrap_or(RECENT).min(RECENT);
        let mut all: Vec<u32> = self.us[..count].iter().map(|us| us.load(Ordering::Relaxed)).collect();
        all.sort_unstable();
        all
    }
}

/// The picture for the progress line and for `hapfic status`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StatusSnapshot {
    /// Simulated time, s.
    pub time_s: f64,
    /// Foot, m.
    pub foot_position: [f64; 3],
    /// F, N.
    pub foot_force: [f64; 3],
    /// F_d, N.
    pub desired_force: [f64; 3],
    /// Missed ticks so far.
    pub missed: u64,
    /// Periods the plant's timer came late so far.
    pub late: u64,
    /// Ticks at which the drive braked after it had been active.
    pub braked: u64,
    /// Code of the mode.
    pub mode: u32,
    /// x - x_d, m.
    pub tracking: [f64; 3],
    /// x_b, m.
    pub bound: [f64; 3],
    /// Version of the parameters in force.
    pub version: u64,
}

/// State shared by the supervisor's threads.
#[derive(Debug, Default)]
pub struct SharedStatus {
    /// All are ready: the gate may start the run.
    pub go: AtomicBool,
    /// The gate should end.
    pub stop: AtomicBool,
    /// The recorder should take in what is left and end.
    pub drain: AtomicBool,
    /// When the recorder last took in all there was, how long it has been listening, and how often it has.
    listened_ns: AtomicU64,
    listening_ns: AtomicU64,
    rounds: AtomicU64,
    /// The log cannot be written any further.
    pub log_failed: AtomicBool,
    /// Last tick whose command went out; -1 before the first.
    pub gated: AtomicI64,
    /// Ticks that the gate's spare has done.
    pub spare_ticks: AtomicU64,
    /// Code of the severity.
    pub severity: AtomicU32,
    /// Processes that shared and do ticks: a bit for each, by its code.
    pub present: AtomicU32,
    /// Processes that should shared and do not, or do no ticks yet.
    pub missing: AtomicU32,
    /// Code of the controller whose requests count if both answer.
    pub primary: AtomicU32,
    /// Latched stops asked for so far, and the code of the detector that asked last.
    pub stops: AtomicU64,
    /// See `stops`.
    pub stop_by: AtomicU32,
    /// Ticks in a row at which each controller's request was rejected, first place first.
    pub bad_requests: [AtomicU32; 2],
    /// Somebody inputs the dead to be swept away: the main thread does that, which knows what has to be done before.
    pub cleanup_requested: AtomicBool,
    /// How often the recorder could not meet somebody.
    pub recorder_unmet: AtomicU32,
    /// Re-armings so far.
    pub rearms: AtomicU64,
    /// Version of the parameters announced last.
    pub announced: AtomicU64,
    /// An operator has asked for the end of the run.
    pub asked_to_stop: AtomicBool,
    /// Requests of operators that could not be read.
    pub requests_rejected: AtomicU64,
    /// For the terminal; no real-time thread touches it.
    pub snapshot: Mutex<StatusSnapshot>,
    /// From state to command.
    pub latencies: Latencies,
    heartbeats: [Heartbeat; Process::ALL.len()],
}

impl SharedStatus {
    /// Nothing has happened yet.
    #[must_use]
    pub fn new() -> Self {
        Self { primary: AtomicU32::new(Process::Controller.code()), gated: AtomicI64::new(-1), ..Self::default() }
    }

    /// Signs of life of a process.
    #[must_use]
    pub fn heartbeat(&self, process: Process) -> &Heartbeat {
        &self.heartbeats[process as usize]
    }

    /// For how long the recorder has listened without hearing of a process, ns. Time in which it did not listen does not count:
    /// a recorder that was held up has heard of nobody, and when the host takes the machine away everybody is held up.
    #[must_use]
    pub fn silence_ns(&self, process: Process) -> Option<u64> {
        let heartbeat = self.heartbeat(process);
        heartbeat.last_ns()?;
        Some(self.listening_ns.load(Ordering::Acquire).saturating_sub(heartbeat.last_at.load(Ordering::Relaxed)))
    }

    /// To be called, by one thread, when everything that had been sent has been taken in.
    pub fn listened(&self) {
        let now = clock::now_ns();
        let gap = now.saturating_sub(self.listened_ns.swap(now, Ordering::AcqRel));
        self.listening_ns.fetch_add(gap.min(ATTENTION_NS), Ordering::AcqRel);
        self.rounds.fetch_add(1, Ordering::Release);
    }

    /// How often that was.
    #[must_use]
    pub fn rounds(&self) -> u64 {
        self.rounds.load(Ordering::Acquire)
    }

    /// A process is started anew: it has not been heard of yet.
    pub fn reset(&self, process: Process, generation: u32) {
        let heartbeat = self.heartbeat(process);
        heartbeat.phase.store(u64::from(generation) << 32, Ordering::Release);
        heartbeat.last_ns.store(0, Ordering::Relaxed);
        heartbeat.rejected.store(0, Ordering::Relaxed);
        heartbeat.failed_connections.store(0, Ordering::Relaxed);
        heartbeat.tick.store(-1, Ordering::Relaxed);
    }

    /// Asks the gate for a latched stop.
    pub fn stop_latched(&self, by: Detector) {
        self.stop_by.store(by.code(), Ordering::Relaxed);
        self.stops.fetch_add(1, Ordering::AcqRel);
    }

    /// Takes note of a timing message.
    pub fn record_heartbeat(&self, timing: &Timing) {
        let Some(heartbeat) = self.heartbeats.get(timing.process as usize) else { return };
        let generation = u64::from(timing.generation);
        if heartbeat.phase.load(Ordering::Acquire) >> 32 != generation {
            return;
        }
        heartbeat.last_ns.store(clock::now_ns(), Ordering::Relaxed);
        heartbeat.last_at.store(self.listening_ns.load(Ordering::Relaxed), Ordering::Relaxed);
        heartbeat.realtime.store(timing.realtime, Ordering::Relaxed);
        heartbeat.rejected.store(timing.rejected, Ordering::Relaxed);
        heartbeat.failed_connections.store(timing.failed_connections, Ordering::Relaxed);
        heartbeat.tick.store(timing.tick, Ordering::Relaxed);
        if timing.process == Process::Supervisor.code() && timing.latency_ns > 0 {
            self.latencies.push(timing.latency_ns);
        }
        let heard = generation << 32 | u64::from(timing.phase + 1);
        // Last, and only if it is still the same process's.
        let _ =
            heartbeat.phase.fetch_update(Ordering::AcqRel, Ordering::Acquire, |now| (now >> 32 == generation).then_some(heard));
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_recorder_that_was_held_up_accuses_nobody() {
        let shared = SharedStatus::new();
        shared.listened();
        assert_eq!(shared.silence_ns(Process::Plant), None);
        shared.record_heartbeat(&Timing { process: Process::Plant.code(), ..Timing::default() });
        // As if the machine had stood still for a second.
        shared.listened_ns.fetch_sub(1_000_000_000, Ordering::Relaxed);
        shared.listened();
        assert!(shared.silence_ns(Process::Plant).unwrap() <= ATTENTION_NS);
        for _ in 0..100 {
            shared.listened_ns.fetch_sub(10_000_000, Ordering::Relaxed);
            shared.listened();
        }
        assert!(shared.silence_ns(Process::Plant).unwrap() >= 1_000_000_000, "a real silence is heard");
        shared.record_heartbeat(&Timing { process: Process::Plant.code(), ..Timing::default() });
        assert_eq!(shared.silence_ns(Process::Plant), Some(0));
    }
}
