//! Checks of this process: its permissions, limits and cores.

use super::check::{Level, MachineCheck, Subject};
use hapfic_ipc::realtime::{self, Privilege};
use rustix::process::{Resource, getrlimit};
use rustix::thread::CpuSet;
use rustix::time::{ClockId, clock_getres};

/// Size of the segments of one run [bytes]: 58 MB by `du --apparent-size`, in 92 files.
const RUN_SEGMENTS: u64 = 60 << 20;
/// Part of them that a run uses [bytes]: 1.4 MB after some seconds, more when its recorder falls behind.
const RUN_USES: u64 = 8 << 20;
/// Open files of a supervisor with all processes connected, and margin for restarted processes.
const FILES_NEEDED: u64 = 300;
const FILES_WANTED: u64 = 1024;
/// Coarsest timer resolution for periods of 1 ms [ns].
const COARSEST_NS: u64 = 10_000;
const MB: f64 = 1e6;

/// Permissions, limits and cores of this process.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProcessInfo {
    /// Usable cores, ascending.
    pub cores: Vec<usize>,
    /// Core that a run would take.
    pub core: Option<usize>,
    /// Privileges, as `hapfic run` finds them.
    pub privileges: Vec<Privilege>,
    /// Resolution of the monotonic clock's timers [ns].
    pub resolution_ns: u64,
    /// Limit of open files; `None`: no limit.
    pub open_files: Option<u64>,
    /// Size and free part of the shared memory [bytes].
    pub shared_memory: Option<(u64, u64)>,
}

impl ProcessInfo {
    /// Queries the kernel, for a run with this highest priority beside `others` other runs.
    #[must_use]
    pub fn ask(priority: u32, others: usize) -> Self {
        let set = rustix::thread::sched_getaffinity(None);
        let cores = set.map(|set| (0..CpuSet::MAX_CPU).filter(|core| set.is_set(*core)).collect()).unwrap_or_default();
        let step = clock_getres(ClockId::Monotonic);
        let memory = rustix::fs::statvfs("/dev/shm").ok();
        Self {
            cores,
            core: realtime::shared_core(others).map(|core| core as usize),
            privileges: realtime::privileges(priority as i32),
            resolution_ns: (step.tv_sec as u64).saturating_mul(1_000_000_000).saturating_add(step.tv_nsec as u64),
            open_files: getrlimit(Resource::Nofile).current,
            shared_memory: memory.map(|m| (m.f_blocks.saturating_mul(m.f_frsize), m.f_bavail.saturating_mul(m.f_frsize))),
        }
    }

    fn privilege(&self, name: &str) -> Option<&Privilege> {
        self.privileges.iter().find(|privilege| privilege.name == name)
    }

    fn may(&self, name: &str) -> bool {
        self.privilege(name).is_some_and(|privilege| privilege.granted)
    }

    /// Whether memory may be locked.
    pub(super) fn may_lock(&self) -> bool {
        self.may(Subject::MemoryLock.name())
    }

    /// Whether deep idle states may be disabled.
    pub(super) fn may_hold_idle(&self) -> bool {
        self.may(Subject::CpuLatencyGuard.name())
    }

    fn permission(&self, subject: Subject, lacking: Level, wanted: &'static str) -> MachineCheck {
        match self.privilege(subject.name()) {
            Some(privilege) if privilege.granted => MachineCheck::good(subject, &privilege.note, wanted),
            Some(privilege) => MachineCheck::at(lacking, subject, "not allowed", wanted, &privilege.note),
            None => MachineCheck::unknown(subject, wanted),
        }
    }

    /// Checks whether threads may have a real-time priority.
    pub(super) fn priority(&self) -> MachineCheck {
        self.permission(Subject::Priority, Level::Bad, "allowed: else any other program may delay a tick")
    }

    /// Checks whether memory may be locked.
    pub(super) fn memory_lock(&self) -> MachineCheck {
        self.permission(Subject::MemoryLock, Level::Bad, "allowed: else a tick may wait for a page")
    }

    /// Checks whether deep idle states may be disabled.
    pub(super) fn idle_hold(&self) -> MachineCheck {
        self.permission(Subject::CpuLatencyGuard, Level::Fair, "allowed: else the processor wakes up late")
    }

    /// Checks the resolution of timers.
    pub(super) fn resolution(&self) -> MachineCheck {
        let level = if self.resolution_ns <= COARSEST_NS { Level::Good } else { Level::Bad };
        let found = format!("{} ns", self.resolution_ns);
        let how = "boot without `highres=off`, with a kernel that has CONFIG_HIGH_RES_TIMERS=y";
        MachineCheck::at(level, Subject::Resolution, found, "10 us or finer", how)
    }

    /// Checks the free shared memory.
    pub(super) fn shared_memory(&self) -> MachineCheck {
        const WANTED: &str = "48 MB free for each run; it uses 2 MB of them, 8 MB with its recorder behind";
        let Some((size, free)) = self.shared_memory else { return MachineCheck::unknown(Subject::SharedMemory, WANTED) };
        let level = match free {
            free if free < RUN_USES => Level::Bad,
            free if free < RUN_SEGMENTS => Level::Fair,
            _ => Level::Good,
        };
        let found = format!("{:.0} MB free of {:.0}", free as f64 / MB, size as f64 / MB);
        let how = "as root: `mount -o remount,size=256M /dev/shm`; for a container `--shm-size=256m`";
        MachineCheck::at(level, Subject::SharedMemory, found, WANTED, how)
    }

    /// Checks the limit of open files.
    pub(super) fn open_files(&self) -> MachineCheck {
        const WANTED: &str = "1024 or more; a run has some 270 open";
        let level = match self.open_files {
            Some(limit) if limit < FILES_NEEDED => Level::Bad,
            Some(limit) if limit < FILES_WANTED => Level::Fair,
            _ => Level::Good,
        };
        let found = self.open_files.map_or("any number".to_owned(), |limit| limit.to_string());
        let how = "`ulimit -n 4096`, or `@realtime - nofile 4096` in /etc/security/limits.conf";
        MachineCheck::at(level, Subject::OpenFiles, found, WANTED, how)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hapfic_ipc::topic::{OPERATOR, RECORDER_DEPTH, TIMING};
    use hapfic_messages::{Command, Event, Operator, Reference, Request, State, Timing};

    #[test]
    fn process_info_query_has_all_privileges() {
        let process_info = ProcessInfo::ask(80, 0);
        assert!(process_info.core.is_none_or(|core| process_info.cores.contains(&core)));
        for subject in [Subject::Priority, Subject::MemoryLock, Subject::CpuLatencyGuard] {
            assert!(process_info.privilege(subject.name()).is_some(), "{subject:?} has the name that `privileges` gives it");
        }
        assert!(process_info.resolution_ns > 0);
    }

    /// Fails when messages have grown so much that the constant must be measured again.
    #[test]
    fn run_messages_fit_into_needed_memory() {
        // A full queue for each of twelve subscribers.
        let queue = 12 * (RECORDER_DEPTH + 2);
        let operator = 12 * (OPERATOR.depth + 2) * size_of::<Operator>();
        let singles = size_of::<Command>();
        let pairs = 2 * (size_of::<State>() + size_of::<Reference>() + size_of::<Request>());
        let all = TIMING.publishers / 2 * (size_of::<Event>() + size_of::<Timing>());
        let bytes = (queue * (singles + pairs + all) + operator) as u64;
        assert!(bytes < RUN_SEGMENTS && bytes > RUN_SEGMENTS / 2, "{bytes} bytes of messages");
    }

    #[test]
    fn limits_below_needs_of_run_are_bad() {
        let process_info = |free: u64, files: Option<u64>| ProcessInfo {
            cores: vec![0],
            core: Some(0),
            privileges: Vec::new(),
            resolution_ns: 1,
            open_files: files,
            shared_memory: Some((64 << 20, free)),
        };
        let levels = |process_info: &ProcessInfo| (process_info.shared_memory().level, process_info.open_files().level);
        assert_eq!(levels(&process_info(1 << 20, Some(256))), (Level::Bad, Level::Bad));
        assert_eq!(levels(&process_info(16 << 20, Some(512))), (Level::Fair, Level::Fair));
        assert_eq!(levels(&process_info(60 << 20, Some(1024))), (Level::Good, Level::Good));
        assert_eq!(process_info(0, None).open_files().level, Level::Good);
        assert_eq!(process_info(0, None).priority().level, Level::Unknown);
        assert_eq!(ProcessInfo { resolution_ns: 4_000_000, ..process_info(0, None) }.resolution().level, Level::Bad);
    }
}
