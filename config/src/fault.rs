//! Faults on purpose: which kinds there are, and what they happen to.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A fault that is to happen, as drawn.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub struct Fault {
    /// The tick at which it begins; 0 in a fault for a running stack: at once.
    pub tick: i64,
    /// What happens.
    pub kind: FaultKind,
    /// What it happens to.
    pub target: FaultTarget,
    /// How long it lasts, ticks of 1 ms; at least 1, but 0 for `kill`, `full_disk` and `memory_lock`, which know no length.
    pub ticks: u32,
    /// By how much a tick is slowed, us; at least 1 for `slow`, 0 for all others.
    pub by_us: u32,
}

/// What happens.
#[derive(Clone, Copy, Debug, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// The process is killed.
    Kill,
    /// The process is halted for a while, as by a debugger.
    Stop,
    /// Each tick of the process takes longer, for a while.
    Slow,
    /// What the process publishes is lost.
    Drop,
    /// The process publishes its message of the tick before once more.
    Repeat,
    /// Bits of what the process publishes are turned over.
    Corrupt,
    /// Numbers of what the process publishes are nan.
    Nan,
    /// What the process publishes carries an old tick.
    Stale,
    /// Something else takes the processors' time.
    Hog,
    /// No more can be written to the log.
    FullDisk,
    /// The process may lock no memory.
    MemoryLock,
}

/// What a fault happens to.
#[derive(Clone, Copy, Debug, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultTarget {
    /// The plant.
    Plant,
    /// The planner.
    Planner,
    /// The controller in the place `controller`, primary or not.
    Controller,
    /// The controller in the place `standby`, primary or not.
    Standby,
    /// Both controllers at once.
    Controllers,
    /// The process that watches over the others.
    Supervisor,
    /// No process: what all of them run on. It has no word in a scenario; its kinds take no process.
    #[serde(skip)]
    Machine,
}

/// All that do ticks under the supervisor, with the supervisor itself at the end.
const PROCESSES: &[FaultTarget] = &[
    FaultTarget::Plant,
    FaultTarget::Planner,
    FaultTarget::Controller,
    FaultTarget::Standby,
    FaultTarget::Controllers,
    FaultTarget::Supervisor,
];

impl FaultKind {
    /// Its word in a scenario.
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

    /// Whether it has a length.
    pub(crate) const fn lasts(self) -> bool {
        !matches!(self, Self::Kill | Self::FullDisk | Self::MemoryLock)
    }

    /// The processes it can happen to; none: it happens to the machine.
    pub(crate) fn processes(self) -> &'static [FaultTarget] {
        match self {
            Self::Hog | Self::FullDisk => &[],
            Self::Kill => PROCESSES,
            // A supervisor that is halted or publishes nonsense would have to be watched by somebody else.
            _ => &PROCESSES[..PROCESSES.len() - 1],
        }
    }
}

impl FaultTarget {
    /// Its word in a scenario, or `machine`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plant => "plant",
            Self::Planner => "planner",
            Self::Controller => "controller",
            Self::Standby => "standby",
            Self::Controllers => "controllers",
            Self::Supervisor => "supervisor",
            Self::Machine => "machine",
        }
    }
}
