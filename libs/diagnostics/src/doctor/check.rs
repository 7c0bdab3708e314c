//! Check of one property of a machine: its level, what was found and wanted, and how to improve it.

use serde::{Serialize, Serializer};

/// Suitability for 1 kHz.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// As wanted.
    Good,
    /// May cost latency.
    Fair,
    /// Costs latency.
    Bad,
    /// Not reported by this kernel.
    Unknown,
}

impl Level {
    /// Name in the table.
    #[must_use]
    pub fn mark(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Bad => "BAD",
            Self::Unknown => "unknown",
        }
    }
}

/// Subject of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Subject {
    /// Version of the kernel.
    Kernel,
    /// Preemption model of the kernel.
    Preemption,
    /// Whether threads may have a real-time priority.
    Priority,
    /// Whether memory may be locked.
    MemoryLock,
    /// Whether deep idle states may be disabled.
    CpuLatencyGuard,
    /// Share of each period that real-time threads may use.
    Throttling,
    /// Clock source of the kernel.
    Clock,
    /// Resolution of timers.
    Resolution,
    /// Usable cores.
    Cores,
    /// Whether the run's core is isolated from other processes.
    Isolation,
    /// Whether the run's core shares its execution units with another one.
    Siblings,
    /// Exit latency of the deepest idle state of the run's core.
    IdleStates,
    /// Frequency governor of the run's core.
    Governor,
    /// Whether the frequency may rise above the nominal one.
    Turbo,
    /// Whether this is a virtual machine.
    Hypervisor,
    /// Steal time since boot.
    Steal,
    /// Load of the machine.
    Load,
    /// Processor time that this process's control group may use.
    Quota,
    /// Free shared memory.
    SharedMemory,
    /// Limit of open files.
    OpenFiles,
    /// Whether memory may be swapped out.
    Swap,
    /// Whether the kernel merges pages to huge pages.
    HugePages,
}

impl Subject {
    /// Name in the table.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Kernel => "kernel",
            Self::Preemption => "preemption",
            Self::Priority => "SCHED_FIFO",
            Self::MemoryLock => "memory lock",
            Self::CpuLatencyGuard => "no deep idle",
            Self::Throttling => "RT throttling",
            Self::Clock => "clock source",
            Self::Resolution => "timer steps",
            Self::Cores => "cores",
            Self::Isolation => "isolated cores",
            Self::Siblings => "SMT sibling",
            Self::IdleStates => "idle states",
            Self::Governor => "governor",
            Self::Turbo => "turbo",
            Self::Hypervisor => "hypervisor",
            Self::Steal => "steal",
            Self::Load => "load",
            Self::Quota => "CPU quota",
            Self::SharedMemory => "shared memory",
            Self::OpenFiles => "open files",
            Self::Swap => "swap",
            Self::HugePages => "huge pages",
        }
    }
}

/// Check of one property of a machine.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct MachineCheck {
    /// Subject of the check.
    pub subject: Subject,
    /// Suitability.
    pub level: Level,
    /// Found value.
    pub found: String,
    /// Wanted value.
    pub wanted: &'static str,
    /// Instruction, a command or a line of a file; `None` where the value is as wanted, or nothing helps.
    pub how: Option<String>,
}

impl MachineCheck {
    /// Makes a check with the wanted value.
    pub(super) fn good(subject: Subject, found: impl Into<String>, wanted: &'static str) -> Self {
        Self { subject, level: Level::Good, found: found.into(), wanted, how: None }
    }

    /// Makes a check of a value that this kernel does not report.
    pub(super) fn unknown(subject: Subject, wanted: &'static str) -> Self {
        Self { subject, level: Level::Unknown, found: "not reported by this kernel".to_owned(), wanted, how: None }
    }

    /// Makes a check at a level, with the instruction if that is not `Good`.
    pub(super) fn at(
        level: Level,
        subject: Subject,
        found: impl Into<String>,
        wanted: &'static str,
        how: impl Into<String>,
    ) -> Self {
        let how = (level != Level::Good).then(|| how.into());
        Self { subject, level, found: found.into(), wanted, how }
    }
}

/// All checks of a machine.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MachineChecks(pub Vec<MachineCheck>);

impl MachineChecks {
    /// Finds the check of a subject.
    #[must_use]
    pub fn get(&self, subject: Subject) -> Option<&MachineCheck> {
        self.0.iter().find(|check| check.subject == subject)
    }

    /// Level of a subject; `Unknown` where there is no such check.
    #[must_use]
    pub fn level(&self, subject: Subject) -> Level {
        self.get(subject).map_or(Level::Unknown, |check| check.level)
    }
}

impl Serialize for MachineChecks {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.serialize(serializer)
    }
}
