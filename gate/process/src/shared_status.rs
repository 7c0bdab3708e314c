//! What the supervisor's threads tell each other: plain atomics, so that the gate never waits for anybody.

use hapfic_ipc::clock;
use hapfic_messages::{Detector, Phase, Process, Timing};
use hapfic_sync::GenerationCell;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU32, AtomicU64, Ordering};

/// The recorder listens every ten milliseconds; a gap longer than this, ns, counts as no more than it.
const ATTENTION_NS: u64 = 20_000_000;

/// Words of a heartbeat: its generation's tag, and what [`Heartbeat`] holds.
const WORDS: usize = 6;

/// Last heartbeat of the present generation of a process; the default stands for none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heartbeat {
    /// When it was recorded [ns]; `None`: there was none.
    last_ns: Option<u64>,
    /// How long the recorder had listened by then [ns].
    listened_ns: u64,
    phase: Option<Phase>,
    tick: i64,
    realtime: u32,
    rejected: u32,
    failed_connections: u32,
}

impl Default for Heartbeat {
    fn default() -> Self {
        Self { last_ns: None, listened_ns: 0, phase: None, tick: -1, realtime: 0, rejected: 0, failed_connections: 0 }
    }
}

impl Heartbeat {
    fn from_words([_, last_ns, listened_ns, phase, tick, counts]: [u64; WORDS]) -> Self {
        Self {
            last_ns: Some(last_ns),
            listened_ns,
            phase: Phase::from_code(phase as u32),
            tick: tick as i64,
            realtime: (phase >> 32) as u32,
            rejected: counts as u32,
            failed_connections: (counts >> 32) as u32,
        }
    }

    /// Words of a timing message that was recorded at `now_ns`, when the recorder had listened for `listened_ns`.
    fn words(timing: &Timing, now_ns: u64, listened_ns: u64) -> [u64; WORDS] {
        let pair = |low: u32, high: u32| u64::from(low) | u64::from(high) << 32;
        let counts = pair(timing.rejected, timing.failed_connections);
        [0, now_ns, listened_ns, pair(timing.phase, timing.realtime), timing.tick as u64, counts]
    }

    /// Phase of the process; `None` before its first heartbeat.
    #[must_use]
    pub fn phase(&self) -> Option<Phase> {
        self.phase
    }

    /// Last tick that the process reported; -1 before the first.
    #[must_use]
    pub fn tick(&self) -> i64 {
        self.tick
    }

    /// Age of the heartbeat [ns]; `None` without one.
    #[must_use]
    pub fn age_ns(&self) -> Option<u64> {
        self.last_ns.map(|last| clock::now_ns().saturating_sub(last))
    }

    /// Messages that the process has rejected since it started.
    #[must_use]
    pub fn rejected(&self) -> u32 {
        self.rejected
    }

    /// Connections that the process could not make since it started.
    #[must_use]
    pub fn failed_connections(&self) -> u32 {
        self.failed_connections
    }

    /// Real-time privileges of the process, bits of [`hapfic_ipc::realtime::SchedGrants`].
    #[must_use]
    pub fn realtime(&self) -> u32 {
        self.realtime
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
    pub recorder_failed_connections: AtomicU32,
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
    heartbeats: [GenerationCell<WORDS>; Process::ALL.len()],
}

impl SharedStatus {
    /// Nothing has happened yet.
    #[must_use]
    pub fn new() -> Self {
        Self { primary: AtomicU32::new(Process::Controller.code()), gated: AtomicI64::new(-1), ..Self::default() }
    }

    /// Last heartbeat of the present generation of a process.
    #[must_use]
    pub fn heartbeat(&self, process: Process) -> Heartbeat {
        self.heartbeats[process as usize].read().map_or_else(Heartbeat::default, Heartbeat::from_words)
    }

    /// How long the recorder has listened since a process's last heartbeat [ns]; `None` without one. Time in which it did not listen does
    /// not count: a recorder that was held up has recorded nothing, and when the host takes the machine away all processes are held up.
    #[must_use]
    pub fn silence_ns(&self, process: Process) -> Option<u64> {
        let heartbeat = self.heartbeat(process);
        heartbeat.last_ns?;
        Some(self.listening_ns.load(Ordering::Acquire).saturating_sub(heartbeat.listened_ns))
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

    /// Expects heartbeats of another generation of a process: those of the one before do not count any more.
    pub fn reset(&self, process: Process, generation: u32) {
        self.heartbeats[process as usize].expect(generation);
    }

    /// Asks the gate for a latched stop.
    pub fn stop_latched(&self, by: Detector) {
        self.stop_by.store(by.code(), Ordering::Relaxed);
        self.stops.fetch_add(1, Ordering::AcqRel);
    }

    /// Records a timing message. By one thread only: the recorder's.
    pub fn record_heartbeat(&self, timing: &Timing) {
        let Some(cell) = self.heartbeats.get(timing.process as usize) else { return };
        let words = Heartbeat::words(timing, clock::now_ns(), self.listening_ns.load(Ordering::Relaxed));
        cell.write(timing.generation, words);
        if timing.process == Process::Supervisor.code() && timing.latency_ns > 0 {
            self.latencies.push(timing.latency_ns);
        }
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

    #[test]
    fn heartbeat_of_a_predecessor_does_not_count() {
        let shared = SharedStatus::new();
        let timing =
            Timing { process: Process::Planner.code(), phase: Phase::Running.code(), tick: 7, rejected: 3, ..Timing::default() };
        shared.record_heartbeat(&timing);
        let heartbeat = shared.heartbeat(Process::Planner);
        assert_eq!((heartbeat.phase(), heartbeat.tick(), heartbeat.rejected()), (Some(Phase::Running), 7, 3));
        shared.reset(Process::Planner, 1);
        assert_eq!(shared.heartbeat(Process::Planner), Heartbeat::default());
        assert_eq!(shared.silence_ns(Process::Planner), None);
        shared.record_heartbeat(&timing);
        assert_eq!(shared.heartbeat(Process::Planner), Heartbeat::default(), "a late message of the predecessor");
        let own = Timing { generation: 1, tick: 8, failed_connections: 2, realtime: 5, ..timing };
        shared.record_heartbeat(&own);
        let heartbeat = shared.heartbeat(Process::Planner);
        assert_eq!((heartbeat.tick(), heartbeat.failed_connections(), heartbeat.realtime()), (8, 2, 5));
    }
}
