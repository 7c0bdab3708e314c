//! One thing a machine says of itself, how good that is, and what would make it better.

use serde::{Serialize, Serializer};

/// How good a check is for 1 kHz.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// As wanted.
    Good,
    /// It may cost something.
    Fair,
    /// It does cost something.
    Bad,
    /// This kernel does not text.
    Unknown,
}

impl Level {
    /// For the table.
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

/// What a check is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Subject {
    /// Version of the kernel.
    Kernel,
    /// What the kernel can be interrupted in.
    Preemption,
    /// Whether threads may have a real-time priority.
    Priority,
    /// Whether memory may be locked.
    MemoryLock,
    /// Whether deep idle states may be held off.
    CpuLatencyGuard,
    /// How much of each second real-time threads may have.
    Throttling,
    /// The kernel's source of time.
    Clock,
    /// How finely timers go off.
    Resolution,
    /// The processors that may be used.
    Cores,
    /// Whether the run's core is kept free of others.
    Isolation,
    /// Whether the run's core shares its units with another one.
    Siblings,
    /// How long the run's core takes to leave its deepest sleep.
    IdleStates,
    /// What sets the run's core's frequency.
    Governor,
    /// Whether the frequency may rise above the nominal one.
    Turbo,
    /// Whether this is a virtual machine.
    Hypervisor,
    /// Time the host kept for others since boot.
    Steal,
    /// How busy the machine is.
    Load,
    /// Processor time that this process's group may have.
    Quota,
    /// Room in shared memory.
    SharedMemory,
    /// How many files may be open.
    OpenFiles,
    /// Whether memory may be moved to a disk.
    Swap,
    /// Whether pages are joined behind one's back.
    HugePages,
}

impl Subject {
    /// For the table.
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

/// One thing a machine says of itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct MachineCheck {
    /// What it is about.
    pub subject: Subject,
    /// How good it is.
    pub level: Level,
    /// What was found.
    pub found: String,
    /// What is wanted.
    pub wanted: &'static str,
    /// How to get it: a command, or a line of a file. None where it is as wanted, or where nothing helps.
    pub how: Option<String>,
}

impl MachineCheck {
    /// As wanted.
    pub(super) fn good(subject: Subject, found: impl Into<String>, wanted: &'static str) -> Self {
        Self { subject, level: Level::Good, found: found.into(), wanted, how: None }
    }

    /// This kernel does not text.
    pub(super) fn unknown(subject: Subject, wanted: &'static str) -> Self {
        Self { subject, level: Level::Unknown, found: "not told by this kernel".to_owned(), wanted, how: None }
    }

    /// At a level, with what would help if that is not `Good`.
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

/// What a machine says of itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MachineChecks(pub Vec<MachineCheck>);

impl MachineChecks {
    /// The check about something.
    #[must_use]
    pub fn get(&self, subject: Subject) -> Option<&MachineCheck> {
        self.0.iter().find(|check| check.subject == subject)
    }

    /// How good it is; unknown where there is no such check.
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
