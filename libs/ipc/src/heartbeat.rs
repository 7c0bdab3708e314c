//! Heartbeats: a shared page in which each process itself writes its last tick and phase.
//!
//! A reader needs no other thread between itself and the process, so a late recorder delays no heartbeat. Each process has
//! cache lines of its own. Words carry the generation of their writer: those of a predecessor do not count.

use crate::clock;
use crate::error::IpcError;
use crate::shared_page::{PageContent, SharedPage};
use hapfic_messages::{Phase, Process, Timing};
use hapfic_sync::GenerationCell;

/// Name of the page in the run's folder.
const FILE: &str = "heartbeats";
/// Words of a heartbeat: the tag of its generation, time, phase and privileges, tick, counts.
const WORDS: usize = 5;

/// Heartbeat of one process, on cache lines of its own.
#[repr(C, align(128))]
#[derive(Debug)]
struct Line(GenerationCell<WORDS>);

// SAFETY: `GenerationCell` holds atomics only, and zero stands for no heartbeat of generation 0.
unsafe impl PageContent for [Line; Process::ALL.len()] {}

/// Last heartbeat of the present generation of a process; the default stands for none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heartbeat {
    /// Time of the heartbeat, `CLOCK_MONOTONIC` [ns]; `None` without a heartbeat.
    pub stamp_ns: Option<u64>,
    /// Phase of the process; `None` before its first heartbeat.
    pub phase: Option<Phase>,
    /// Last tick of the process; -1 before the first.
    pub tick: i64,
    /// Real-time privileges, bits of [`SchedGrants`](crate::realtime::SchedGrants).
    pub realtime: u32,
    /// Messages rejected since the start of the process.
    pub rejected: u32,
    /// Failed connections since the start of the process.
    pub failed_connections: u32,
}

impl Default for Heartbeat {
    fn default() -> Self {
        Self { stamp_ns: None, phase: None, tick: -1, realtime: 0, rejected: 0, failed_connections: 0 }
    }
}

impl Heartbeat {
    fn from_words([_, stamp_ns, phase, tick, counts]: [u64; WORDS]) -> Self {
        Self {
            stamp_ns: Some(stamp_ns),
            phase: Phase::from_code(phase as u32),
            tick: tick as i64,
            realtime: (phase >> 32) as u32,
            rejected: counts as u32,
            failed_connections: (counts >> 32) as u32,
        }
    }

    /// Age of the heartbeat [ns]; `None` without one.
    #[must_use]
    pub fn age_ns(&self) -> Option<u64> {
        self.stamp_ns.map(|stamp| clock::now_ns().saturating_sub(stamp))
    }
}

/// Heartbeats of all processes of a run.
#[derive(Debug)]
pub struct HeartbeatPage(SharedPage<[Line; Process::ALL.len()]>);

impl HeartbeatPage {
    /// Maps the page in a run's folder; creates it if it is missing.
    ///
    /// # Errors
    /// [`IpcError::System`] if that fails.
    pub(crate) fn open(folder: &str) -> Result<Self, IpcError> {
        SharedPage::open(folder, FILE, "share the heartbeats of the run").map(Self)
    }

    /// Maps a page that only this process sees.
    ///
    /// # Errors
    /// [`IpcError::System`] without memory.
    pub fn private() -> Result<Self, IpcError> {
        SharedPage::private().map(Self)
    }

    /// Writes the heartbeat of a process from its timing message. Only the process itself may call it, from one thread at
    /// a time; wait-free.
    pub fn write(&self, timing: &Timing, now_ns: u64) {
        let pair = |low: u32, high: u32| u64::from(low) | u64::from(high) << 32;
        if let Some(line) = self.0.get(timing.process as usize) {
            let counts = pair(timing.rejected, timing.failed_connections);
            line.0.write(timing.generation, [0, now_ns, pair(timing.phase, timing.realtime), timing.tick as u64, counts]);
        }
    }

    /// Reads the last heartbeat of the expected generation of a process.
    #[must_use]
    pub fn read(&self, process: Process) -> Heartbeat {
        self.0[process as usize].0.read().map_or_else(Heartbeat::default, Heartbeat::from_words)
    }

    /// Expects heartbeats of another generation of a process: those of the previous generation no longer count.
    pub fn expect(&self, process: Process, generation: u32) {
        self.0[process as usize].0.expect(generation);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn heartbeat_of_predecessor_does_not_count() {
        let folder = tempfile::tempdir().unwrap();
        let open = || HeartbeatPage::open(folder.path().to_str().unwrap()).unwrap();
        let (process, supervisor) = (open(), open());
        assert_eq!(supervisor.read(Process::Planner), Heartbeat::default());
        let timing =
            Timing { process: Process::Planner.code(), phase: Phase::Running.code(), tick: 7, rejected: 3, ..Timing::default() };
        process.write(&timing, 50);
        let heartbeat = supervisor.read(Process::Planner);
        assert_eq!(
            (heartbeat.stamp_ns, heartbeat.phase, heartbeat.tick, heartbeat.rejected),
            (Some(50), Some(Phase::Running), 7, 3)
        );
        assert_eq!(supervisor.read(Process::Plant), Heartbeat::default());
        supervisor.expect(Process::Planner, 1);
        assert_eq!(supervisor.read(Process::Planner), Heartbeat::default());
        process.write(&timing, 60);
        assert_eq!(supervisor.read(Process::Planner), Heartbeat::default(), "a late heartbeat of the predecessor");
        process.write(&Timing { generation: 1, tick: 8, failed_connections: 2, realtime: 5, ..timing }, 70);
        let heartbeat = supervisor.read(Process::Planner);
        assert_eq!((heartbeat.tick, heartbeat.failed_connections, heartbeat.realtime), (8, 2, 5));
    }

    #[test]
    fn line_fills_whole_cache_lines() {
        assert_eq!(size_of::<Line>(), 128);
    }
}
