//! Status that supervisor and gate share: a page in the run's folder, in parts with one writer each. All are atomics: the
//! gate never waits for another process. The page outlives every gate.

use crate::error::IpcError;
use crate::heartbeat::HeartbeatPage;
use crate::shared_page::{PageContent, SharedPage};
use core::ops::Deref;
use core::sync::atomic::{AtomicI64, AtomicU32, AtomicU64, Ordering};
use hapfic_messages::{Detector, Process};

/// Name of the page in the run's folder.
const FILE: &str = "status";

/// Status shared by supervisor and gate, and the heartbeats of all processes, which they write themselves.
#[derive(Debug)]
pub struct SharedStatus {
    page: SharedPage<RunStatus>,
    /// Heartbeats of all processes.
    pub heartbeats: HeartbeatPage,
}

/// Content of the page.
#[derive(Debug)]
#[repr(C)]
pub struct RunStatus {
    /// Orders to the gate.
    pub orders: RunOrders,
    /// Processes that are there, and that are missing.
    pub presence: Presence,
    /// Report of the gate.
    pub gate: GateReport,
    /// Report of the thread that answers operators.
    pub operator: OperatorReport,
}

// SAFETY: atomics only, of integers, for which every bit pattern is valid; `SharedStatus::create` writes the initial values
// that are not zero.
unsafe impl PageContent for RunStatus {}

impl SharedStatus {
    /// Creates the status of a run in its folder. Only the launcher may call it, before any other process starts.
    ///
    /// # Errors
    /// [`IpcError::System`] if the page cannot be created or mapped.
    pub fn create(folder: &str) -> Result<Self, IpcError> {
        let status = Self::open(folder)?;
        status.gate.tick.store(-1, Ordering::Relaxed);
        status.gate.primary.store(Process::Controller.code(), Ordering::Release);
        Ok(status)
    }

    /// Maps the status of a run in its folder.
    ///
    /// # Errors
    /// [`IpcError::System`] if the page cannot be mapped.
    pub fn open(folder: &str) -> Result<Self, IpcError> {
        let page = SharedPage::open(folder, FILE, "share the status of the run")?;
        Ok(Self { page, heartbeats: HeartbeatPage::open(folder)? })
    }
}

impl Deref for SharedStatus {
    type Target = RunStatus;

    fn deref(&self) -> &RunStatus {
        &self.page
    }
}

/// A flag in shared memory.
#[derive(Debug, Default)]
#[repr(transparent)]
pub struct Flag(AtomicU32);

impl Flag {
    /// Whether the flag is set.
    #[must_use]
    pub fn load(&self, ordering: Ordering) -> bool {
        self.0.load(ordering) != 0
    }

    /// Sets or clears the flag.
    pub fn store(&self, value: bool, ordering: Ordering) {
        self.0.store(value.into(), ordering);
    }

    /// Sets or clears the flag; returns whether it was set.
    pub fn swap(&self, value: bool, ordering: Ordering) -> bool {
        self.0.swap(value.into(), ordering) != 0
    }
}

/// Orders to the gate, by the main thread and by the thread that answers operators.
#[derive(Debug)]
#[repr(C)]
pub struct RunOrders {
    /// Whether all processes are ready, so that the gate may start the run.
    pub start: Flag,
    /// Whether the gate has to end.
    pub stop: Flag,
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
#[derive(Debug)]
#[repr(C)]
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
#[derive(Debug)]
#[repr(C)]
pub struct GateReport {
    /// Last tick with a published command; -1 before the first.
    pub tick: AtomicI64,
    /// Ticks of the gate that was not the active one.
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
    /// Ticks of the gate that was not the active one.
    pub spare: u64,
    /// Missed ticks.
    pub missed: u64,
    /// Braked ticks.
    pub braked: u64,
    /// Ticks with a torque discontinuity.
    pub discontinuities: u64,
}

/// Report of the thread that answers operators.
#[derive(Debug)]
#[repr(C)]
pub struct OperatorReport {
    /// Whether an operator has requested the end of the run.
    pub end_requested: Flag,
    /// Whether dead clients require a clean-up, which the main thread does.
    pub cleanup_requested: Flag,
    /// Unreadable requests.
    pub rejected: AtomicU64,
}

/// Number of recent latencies: one a tick, for a second.
const RECENT: usize = 1000;

/// Recent latencies from state to command [us].
#[derive(Debug)]
#[repr(C)]
pub struct RecentLatencies {
    us: [AtomicU32; RECENT],
    count: AtomicU64,
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
