//! Fault injection: kinds and targets.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A fault to inject, with its sampled tick and target.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Fault {
    /// First tick; 0 in a fault for a running stack, which begins immediately.
    pub tick: i64,
    /// Kind of fault.
    pub kind: FaultKind,
    /// Target of the fault.
    pub target: FaultTarget,
    /// Length [ticks of 1 ms]; at least 1, but 0 for `kill`, `full_disk` and `memory_lock`, which have no length.
    pub ticks: u32,
    /// Delay of each tick [us]; at least 1 for `slow`, 0 for all other kinds.
    pub by_us: u32,
}

/// Kind of fault.
#[derive(Clone, Copy, Debug, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// The process is killed.
    Kill,
    /// The process is halted for the length, as by a debugger.
    Stop,
    /// Each tick of the process takes longer, for the length.
    Slow,
    /// The process's messages are lost.
    Drop,
    /// The process publishes its message of the previous tick again.
    Repeat,
    /// Bits of the process's messages are inverted.
    Corrupt,
    /// Numbers in the process's messages are nan.
    Nan,
    /// The process's messages carry an old tick.
    Stale,
    /// An external load takes the processors' time.
    Hog,
    /// The disk of the log is full.
    FullDisk,
    /// The process cannot lock memory.
    MemoryLock,
}

/// Target of a fault.
#[derive(Clone, Copy, Debug, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultTarget {
    /// The plant.
    Plant,
    /// The planner.
    Planner,
    /// The controller in the slot `controller`, primary or not.
    Controller,
    /// The controller in the slot `standby`, primary or not.
    Standby,
    /// Both controllers at the same tick.
    Controllers,
    /// The supervisor.
    Supervisor,
    /// The gate, active or not.
    Gate,
    /// The spare gate, active or not.
    SpareGate,
    /// The recorder.
    Recorder,
    /// The machine, for kinds that take no process. It has no word in a scenario.
    #[serde(skip)]
    Machine,
}

/// All processes that run ticks, then the recorder and the supervisor.
const PROCESSES: &[FaultTarget] = &[
    FaultTarget::Plant,
    FaultTarget::Planner,
    FaultTarget::Controller,
    FaultTarget::Standby,
    FaultTarget::Controllers,
    FaultTarget::Gate,
    FaultTarget::SpareGate,
    FaultTarget::Recorder,
    FaultTarget::Supervisor,
];

impl FaultKind {
    /// Returns the word in a scenario.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Kill => "kill",
            Self::Stop => "stop",
            Self::Slow => "slow",
            Self::Drop => "drop",
            Self::Repeat => "repeat",
            Self::Corrupt => "corrupt",
            Self::Nan => "nan",
            Self::Stale => "stale",
            Self::Hog => "hog",
            Self::FullDisk => "full_disk",
            Self::MemoryLock => "memory_lock",
        }
    }

    /// Whether the kind has a length.
    pub(crate) const fn lasts(self) -> bool {
        !matches!(self, Self::Kill | Self::FullDisk | Self::MemoryLock)
    }

    /// Possible target processes; empty: the target is the machine.
    pub(crate) fn processes(self) -> &'static [FaultTarget] {
        match self {
            Self::Hog | Self::FullDisk => &[],
            Self::Kill | Self::Stop => PROCESSES,
            // The recorder takes part in no tick, and nothing stands behind the gates that could reject its messages.
            _ => &PROCESSES[..PROCESSES.len() - 4],
        }
    }
}

impl FaultTarget {
    /// Returns the word in a scenario, or `machine`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plant => "plant",
            Self::Planner => "planner",
            Self::Controller => "controller",
            Self::Standby => "standby",
            Self::Controllers => "controllers",
            Self::Supervisor => "supervisor",
            Self::Gate => "gate",
            Self::SpareGate => "spare_gate",
            Self::Recorder => "recorder",
            Self::Machine => "machine",
        }
    }
}
