//! Page of the supervisor in the run's folder: who supervises the run, and what outlives a supervisor.

use crate::error::IpcError;
use crate::shared_page::{PageContent, SharedPage};
use core::ops::Deref;
use core::sync::atomic::{AtomicI32, AtomicU32, AtomicU64, Ordering};
use hapfic_messages::Process;

/// Name of the page in the run's folder.
const FILE: &str = "supervisor";
/// Faults of a scenario, at most.
const FAULTS: usize = 1 << 20;

/// The page of a run's supervisor. It alone writes, and the launcher its process id; other processes read this and the
/// heartbeat.
#[derive(Debug)]
pub struct SupervisorPage(SharedPage<SupervisorRecord>);

/// Content of the page.
#[derive(Debug)]
#[repr(C)]
pub struct SupervisorRecord {
    /// Process id of the present supervisor, from its start on; 0 before the first.
    pub pid: AtomicI32,
    /// Supervisors that were lost before it.
    pub losses: AtomicU32,
    /// Longest time from the last heartbeat of a supervisor until its successor watches [ns].
    pub longest_ns: AtomicU64,
    /// Its last heartbeat, `CLOCK_MONOTONIC` [ns].
    pub heartbeat_ns: AtomicU64,
    /// Start of the first tick, `CLOCK_MONOTONIC` [ns].
    pub begun_ns: AtomicU64,
    /// Time from the start of the program to the first tick [ns].
    pub launch_ns: AtomicU64,
    /// Steal time since boot at the first tick [ms].
    pub steal_ms: AtomicU64,
    /// Largest delay of the main thread [ns].
    pub largest_delay_ns: AtomicU64,
    /// Number of the last published fault in messages.
    pub injection: AtomicU64,
    /// Injected faults.
    pub injected: AtomicU64,
    /// Whether a fault has filled the disk of the log.
    pub filled: AtomicU32,
    /// The processes of the run by their codes.
    processes: [ProcessRecord; Process::ALL.len()],
    /// Injected faults of the scenario, a bit for each.
    faults: [AtomicU64; FAULTS / 64],
}

/// What outlives the supervisor of a process.
#[derive(Debug)]
#[repr(C)]
pub struct ProcessRecord {
    /// Process id; 0: none runs.
    pid: AtomicI32,
    /// Number of the start.
    pub generation: AtomicU32,
    /// Losses so far.
    pub losses: AtomicU32,
    /// Whether it was lost too often.
    pub given_up: AtomicU32,
    /// Longest time from a loss to the successor's first tick [ns].
    pub longest_ns: AtomicU64,
}

impl ProcessRecord {
    /// Notes the process that runs; `None`: none does.
    pub fn set_pid(&self, pid: Option<i32>) {
        self.pid.store(pid.unwrap_or(0), Ordering::Release);
    }

    /// The process that runs.
    #[must_use]
    pub fn pid(&self) -> Option<i32> {
        Some(self.pid.load(Ordering::Acquire)).filter(|pid| *pid > 0)
    }
}

// SAFETY: atomics only, and zero stands for nothing started, lost and injected.
unsafe impl PageContent for SupervisorRecord {}

impl SupervisorPage {
    /// Maps the page in a run's folder; creates it if it is missing.
    ///
    /// # Errors
    /// [`IpcError::System`] if that fails.
    pub fn open(folder: &str) -> Result<Self, IpcError> {
        SharedPage::open(folder, FILE, "share the page of the supervisor").map(Self)
    }
}

impl Deref for SupervisorPage {
    type Target = SupervisorRecord;

    fn deref(&self) -> &SupervisorRecord {
        &self.0
    }
}

impl SupervisorRecord {
    /// Begins the work of this process as the supervisor, after `losses` others. A successor returns the last heartbeat before
    /// its own [ns].
    pub fn begin(&self, losses: u32, now_ns: u64) -> Option<u64> {
        // The launcher may be late.
        self.pid.store(std::process::id() as i32, Ordering::Release);
        self.losses.store(losses, Ordering::Relaxed);
        let last_ns = self.heartbeat_ns.swap(now_ns, Ordering::AcqRel);
        (last_ns != 0).then_some(last_ns)
    }

    /// Whether the supervisor after `losses` others has begun its work.
    #[must_use]
    pub fn has_begun(&self, losses: u32) -> bool {
        self.heartbeat_ns.load(Ordering::Acquire) != 0 && self.losses.load(Ordering::Relaxed) == losses
    }

    /// Writes the heartbeat of the supervisor.
    pub fn beat(&self, now_ns: u64) {
        self.heartbeat_ns.store(now_ns, Ordering::Release);
    }

    /// Record of a process.
    #[must_use]
    pub fn process(&self, process: Process) -> &ProcessRecord {
        &self.processes[process as usize]
    }

    /// Notes that a fault of the scenario is injected, by its index there.
    pub fn set_injected(&self, fault: usize) {
        if let Some(word) = self.faults.get(fault / 64) {
            word.fetch_or(1 << (fault % 64), Ordering::AcqRel);
        }
    }

    /// Whether a fault of the scenario is injected.
    #[must_use]
    pub fn is_injected(&self, fault: usize) -> bool {
        self.faults.get(fault / 64).is_some_and(|word| word.load(Ordering::Acquire) & 1 << (fault % 64) != 0)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn successor_finds_what_the_supervisor_has_noted() {
        let folder = tempfile::tempdir().unwrap();
        let open = || SupervisorPage::open(folder.path().to_str().unwrap()).unwrap();
        let first = open();
        assert!(!first.has_begun(0));
        assert_eq!(first.begin(0, 100), None);
        assert_eq!([0, 1].map(|losses| first.has_begun(losses)), [true, false]);
        first.process(Process::Gate).set_pid(Some(17));
        first.set_injected(70);
        first.beat(200);
        let second = open();
        assert_eq!(second.begin(1, 500), Some(200));
        assert_eq!((second.losses.load(Ordering::Relaxed), second.heartbeat_ns.load(Ordering::Relaxed)), (1, 500));
        assert_eq!((second.process(Process::Gate).pid(), second.process(Process::Plant).pid()), (Some(17), None));
        assert_eq!([69, 70, 71, 1 << 30].map(|fault| second.is_injected(fault)), [false, true, false, false]);
        second.set_injected(1 << 30);
    }
}
