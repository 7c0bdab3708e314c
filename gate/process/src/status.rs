//! Status that the supervisor's threads share, in parts with one writer each. All are atomics: the gate never waits for
//! another thread.

use hapfic_ipc::HeartbeatPage;
use hapfic_messages::{Detector, Process};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU32, AtomicU64, Ordering};

/// Status shared by the supervisor's threads.
#[derive(Debug)]
pub struct SharedStatus {
    /// Orders to the gate.
    pub orders: RunOrders,
    /// Processes that are there, and that are missing.
    pub presence: Presence,
    /// Report of the gate.
    pub gate: GateReport,
    /// Report of the thread that answers operators.
    pub operator: OperatorReport,
    /// Heartbeats of all processes, which they write themselves.
    pub heartbeats: Arc<HeartbeatPage>,
}

impl SharedStatus {
    /// Status before the run.
    #[must_use]
    pub fn new(heartbeats: Arc<HeartbeatPage>) -> Self {
        Self {
            orders: RunOrders::default(),
            presence: Presence::default(),
            gate: GateReport {
                tick: AtomicI64::new(-1),
                primary: AtomicU32::new(Process::Controller.code()),
                ..GateReport::default()
            },
            operator: OperatorReport::default(),
            heartbeats,
        }
    }
}

/// Orders to the gate, by the main thread and by the thread that answers operators.
#[derive(Debug, Default)]
pub struct RunOrders {
    /// Whether all processes are ready, so that the gate may start the run.
    pub start: AtomicBool,
    /// Whether the gate has to end.
    pub stop: AtomicBool,
    /// Latched stops requested so far.
    pub latched_stops: AtomicU64,
    /// Code of the detector that requested the last latched stop.
    pub stop_by: AtomicU32,
    /// Re-armings so far.
    pub rearms: AtomicU64,
}

impl RunOrders {
    /// Requests a latched stop from the gate.
    pub fn stop_latched(&self, by: Detector) {
        self.stop_by.store(by.code(), Ordering::Relaxed);
        self.latched_stops.fetch_add(1, Ordering::AcqRel);
    }
}

/// Sets of processes, a bit for each by its code; written by the main thread.
#[derive(Debug, Default)]
pub struct Presence {
    /// Processes that are alive and run ticks.
    pub present: AtomicU32,
    /// Required processes that are lost, or run no ticks yet.
    pub missing: AtomicU32,
}

impl Presence {
    /// Whether a required process is lost, or runs no ticks yet.
    #[must_use]
    pub fn is_missing(&self, process: Process) -> bool {
        self.missing.load(Ordering::Acquire) & (1 << process.code()) != 0
    }
}

/// Report of the gate.
#[derive(Debug, Default)]
pub struct GateReport {
    /// Last tick with a published command; -1 before the first.
    pub tick: AtomicI64,
    /// Ticks of the spare gate thread.
    pub spare_ticks: AtomicU64,
    /// Ticks whose command is not from a request of the same tick, after the first active one.
    pub missed_ticks: AtomicU64,
    /// Ticks without an active command, after the first active one.
    pub braked_ticks: AtomicU64,
    /// Ticks with a torque discontinuity.
    pub discontinuities: AtomicU64,
    /// Latched stops that the gate has processed.
    pub processed_stops: AtomicU64,
    /// Code of the severity.
    pub severity: AtomicU32,
    /// Code of the mode of the last command.
    pub mode: AtomicU32,
    /// Latencies from state to command.
    pub latencies: RecentLatencies,
    /// Code of the primary controller.
    pub primary: AtomicU32,
    /// Version of the last announced parameters.
    pub announced: AtomicU64,
    /// Ticks in a row with a rejected request, for each controller slot; the main thread resets it after a restart.
    pub rejected_requests: [AtomicU32; 2],
}

impl GateReport {
    /// Reads the counts.
    #[must_use]
    pub fn counts(&self) -> GateCounts {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        GateCounts {
            spare: read(&self.spare_ticks),
            missed: read(&self.missed_ticks),
            braked: read(&self.braked_ticks),
            discontinuities: read(&self.discontinuities),
        }
    }
}

/// Counts of the gate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GateCounts {
    /// Ticks of the spare gate thread.
    pub spare: u64,
    /// Missed ticks.
    pub missed: u64,
    /// Braked ticks.
    pub braked: u64,
    /// Ticks with a torque discontinuity.
    pub discontinuities: u64,
}

/// Report of the thread that answers operators.
#[derive(Debug, Default)]
pub struct OperatorReport {
    /// Whether an operator has requested the end of the run.
    pub end_requested: AtomicBool,
    /// Whether dead clients require a clean-up, which the main thread does after the hand-over cache is up to date.
    pub cleanup_requested: AtomicBool,
    /// Unreadable requests.
    pub rejected: AtomicU64,
}

/// Number of recent latencies: one a tick, for a second.
const RECENT: usize = 1000;

/// Recent latencies from state to command [us].
#[derive(Debug)]
pub struct RecentLatencies {
    us: [AtomicU32; RECENT],
    count: AtomicU64,
}

impl Default for RecentLatencies {
    fn default() -> Self {
        Self { us: [const { AtomicU32::new(0) }; RECENT], count: AtomicU64::new(0) }
    }
}

impl RecentLatencies {
    /// Adds a latency. Only one thread may call it.
    pub fn push(&self, ns: u64) {
        let count = self.count.load(Ordering::Relaxed);
        self.us[count as usize % RECENT].store(u32::try_from(ns / 1000).unwrap_or(u32::MAX), Ordering::Relaxed);
        self.count.store(count + 1, Ordering::Release);
    }

    /// Recorded latencies in ascending order [us].
    #[must_use]
    pub fn sorted(&self) -> Vec<u32> {
        let count = usize::try_from(self.count.load(Ordering::Acquire)).unwrap_or(RECENT).min(RECENT);
        let mut all: Vec<u32> = self.us[..count].iter().map(|us| us.load(Ordering::Relaxed)).collect();
        all.sort_unstable();
        all
    }
}
