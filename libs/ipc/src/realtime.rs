//! The real-time set-up of a thread and of the machine: takes what it can get and says what it lacks.

use crate::memory;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, CpuSet};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

/// What a thread got; a set of bits that travels in [`hapfic_messages::Timing`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SchedGrants(pub u32);

impl SchedGrants {
    /// The scheduler `SCHED_FIFO` at the priority asked for.
    pub const FIFO: u32 = 1;
    /// All memory of the process is locked.
    pub const LOCKED: u32 = 2;
    /// The thread stays on the core asked for.
    pub const PINNED: u32 = 4;

    /// Whether a bit is set.
    #[must_use]
    pub fn has(self, bit: u32) -> bool {
        self.0 & bit != 0
    }
}

/// What a thread asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SchedRequest {
    /// Priority of `SCHED_FIFO`, 1 to 98.
    pub priority: i32,
    /// Core to stay on.
    pub core: Option<usize>,
}

impl SchedRequest {
    /// A priority, and a core or none.
    #[must_use]
    pub fn new(priority: u32, core: Option<u32>) -> Self {
        Self { priority: priority as i32, core: core.map(|c| c as usize) }
    }
}

/// A core for the real-time threads of a run: the last one this process may use, for the next `index` the one before it, and so on, round
/// and round.
#[must_use]
pub fn shared_core(index: usize) -> Option<u32> {
    let allowed = usable_cores();
    let place = allowed.len().checked_sub(1 + index % allowed.len().max(1))?;
    allowed.get(place).map(|core| *core as u32)
}

/// Cores that this process may use, ascending; none if the system does not tell.
#[must_use]
pub fn usable_cores() -> Vec<usize> {
    let Ok(set) = rustix::thread::sched_getaffinity(None) else { return Vec::new() };
    (0..CpuSet::MAX_CPU).filter(|core| set.is_set(*core)).collect()
}

/// Bytes of stack touched beforehand, so that a deep call does not fault.
const STACK: usize = 256 * 1024;

/// Stack for a small real-time thread, bytes: more than what is touched beforehand.
pub const SMALL_STACK: usize = 2 * STACK;

/// A core for the controller in reserve: another one than the run's shared core, if there is one. A process that dies gives its memory
/// back at its own priority, on its own core: whoever is to take over at once had better not be behind it.
#[must_use]
pub fn reserve_core(index: usize) -> Option<u32> {
    shared_core(index + 1)
}

/// Makes the calling thread a real-time one as far as it may; memory is locked beforehand, by [`lock_memory`]. Nothing fails: what is
/// missing is missing in the result.
#[must_use]
pub fn apply_to_current_thread(wish: SchedRequest) -> SchedGrants {
    memory::prefault_heap();
    apply_without_heap(wish)
}

/// The same for a thread that allocates nothing.
#[must_use]
pub(crate) fn apply_without_heap(wish: SchedRequest) -> SchedGrants {
    let mut granted = 0;
    if MEMORY_LOCKED.load(Ordering::Relaxed) {
        granted |= SchedGrants::LOCKED;
    }
    touch_stack();
    if let Some(core) = wish.core
        && pin(None, core).is_ok()
    {
        granted |= SchedGrants::PINNED;
    }
    if try_set_fifo(wish.priority) {
        granted |= SchedGrants::FIFO;
    }
    SchedGrants(granted)
}

fn try_set_fifo(priority: i32) -> bool {
    let parameters = libc::sched_param { sched_priority: priority };
    // SAFETY: `parameters` lives through the call; 0 names the calling thread.
    unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameters) == 0 }
}

/// Puts the calling thread before all that is not real-time, at a priority of `SCHED_FIFO`, 1 to 98; what it starts is not.
///
/// # Errors
/// If the system refuses.
pub fn set_fifo(priority: u32) -> std::io::Result<()> {
    let parameters = libc::sched_param { sched_priority: priority as i32 };
    // SAFETY: `parameters` lives through the call; 0 names the calling thread.
    let done = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, &raw const parameters) };
    if done == 0 { Ok(()) } else { Err(std::io::Error::last_os_error()) }
}

/// Keeps a process's main thread, or the calling thread, on a core.
///
/// # Errors
/// If there is no such core, or the system refuses.
pub fn pin(pid: Option<rustix::process::Pid>, core: usize) -> std::io::Result<()> {
    if core >= CpuSet::MAX_CPU {
        return Err(std::io::ErrorKind::InvalidInput.into());
    }
    let mut set = CpuSet::new();
    set.set(core);
    Ok(rustix::thread::sched_setaffinity(pid, &set)?)
}

/// Gives another process's main thread a priority of `SCHED_FIFO`, 1 to 98.
///
/// # Errors
/// If the system refuses.
pub fn set_priority_of(pid: rustix::process::Pid, priority: u32) -> std::io::Result<()> {
    let parameters = libc::sched_param { sched_priority: priority as i32 };
    // SAFETY: `parameters` lives through the call.
    let done = unsafe { libc::sched_setscheduler(pid.as_raw_nonzero().get(), libc::SCHED_FIFO, &raw const parameters) };
    if done == 0 { Ok(()) } else { Err(std::io::Error::last_os_error()) }
}

#[inline(never)]
fn touch_stack() {
    let mut stack = [0_u8; STACK];
    for byte in stack.iter_mut().step_by(4096) {
        *byte = 1;
    }
    std::hint::black_box(&stack);
}

fn capable(capability: CapabilitySet) -> bool {
    rustix::thread::capabilities(None).is_ok_and(|sets| sets.effective.contains(capability))
}

/// How much memory is brought in when it is locked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Prefault {
    /// All there is now. For the supervisor: what it holds of the program's file stays in memory for all processes of the stack, so
    /// that theirs never have to wait for a disk.
    All,
    /// The code, and what is used. For the other processes.
    Used,
}

/// Locks all memory of the process, now and in future; every page stays once it was used. To be called before topics are opened.
///
/// A topic's segment has room for the deepest queue of every subscriber there may ever be, and the program for much that a process
/// never runs; a part of both is used. Bringing all of it in would hold up whoever maps it, in the middle of a tick, for as
/// long as a tick; and a process that dies at real-time priority has to give it all back before anyone below it runs again. So what
/// can be used is brought in beforehand, once this has been called, and nothing else: code, a reserve of heap, the messages that can be
/// on their way.
///
/// Only where the limit cannot be reached: with a finite limit a later allocation would fail, and abort the process.
pub fn lock_memory(prefault: Prefault) {
    let used = MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT;
    let all = || mlockall(MlockAllFlags::CURRENT).and_then(|()| mlockall(MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT));
    let locked = may_lock()
        && match prefault {
            Prefault::All => all().is_ok(),
            Prefault::Used => mlockall(used).is_ok(),
        };
    MEMORY_LOCKED.store(locked, Ordering::Relaxed);
    // Without the lock, too: it stays then as long as nobody needs the memory more.
    memory::enable();
    if prefault == Prefault::Used {
        memory::prefault_code();
    }
}

/// Makes room in the process's table of open files for so many, or as many as it may have. To be called before it has threads.
///
/// The kernel doubles the table when it is full. Where threads share it, the one who opens the file too many then waits for all
/// processors to pass a quiet state (`synchronize_rcu`), some 10 ms: the gate did so when it met the first process that was started
/// again.
///
/// # Errors
/// If the system refuses; the table then grows when it has to.
pub fn reserve_fd_table(count: u64) -> std::io::Result<()> {
    let may_have = getrlimit(Resource::Nofile).current.unwrap_or(u64::MAX);
    let last = count.min(may_have).saturating_sub(1);
    let file = File::open("/dev/null")?;
    // The table stays as large as this has made it.
    drop(rustix::io::fcntl_dupfd_cloexec(&file, i32::try_from(last).unwrap_or(i32::MAX))?);
    Ok(())
}

/// Whether the process has locked its memory.
static MEMORY_LOCKED: AtomicBool = AtomicBool::new(false);

fn may_lock() -> bool {
    getrlimit(Resource::Memlock).current.is_none() || capable(CapabilitySet::IPC_LOCK)
}

/// Whether this process may have `SCHED_FIFO` at a priority.
#[must_use]
pub fn may_fifo(priority: i32) -> bool {
    capable(CapabilitySet::SYS_NICE) || rtprio_limit() >= priority as u64
}

fn rtprio_limit() -> u64 {
    getrlimit(Resource::Rtprio).current.unwrap_or(u64::MAX)
}

/// Keeps the processors out of idle states that take long to leave, for as long as it lives.
#[derive(Debug)]
pub struct CpuLatencyGuard(#[allow(dead_code)] File);

/// Where the wish for the longest exit latency is written.
const DMA_LATENCY: &str = "/dev/cpu_dma_latency";

impl CpuLatencyGuard {
    /// Asks for no exit latency at all; `None` if this user may not.
    #[must_use]
    pub fn take() -> Option<Self> {
        let mut file = OpenOptions::new().write(true).open(DMA_LATENCY).ok()?;
        file.write_all(&0_i32.to_ne_bytes()).ok()?;
        Some(Self(file))
    }
}

/// One line of what real time needs: whether it can be had, and if not, what would give it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Privilege {
    /// What it is.
    pub name: &'static str,
    /// Whether this process may.
    pub granted: bool,
    /// The value found, or what to do.
    pub note: String,
}

/// What this process may take, for the highest priority it will ask for.
#[must_use]
pub fn privileges(priority: i32) -> Vec<Privilege> {
    let fifo = may_fifo(priority);
    let lock = may_lock();
    let idle = OpenOptions::new().write(true).open(DMA_LATENCY).is_ok();
    let say = |ok: bool, yes: String, no: &str| if ok { yes } else { no.to_owned() };
    vec![
        Privilege {
            name: "SCHED_FIFO",
            granted: fifo,
            note: say(
                fifo,
                format!("priority up to {priority}"),
                "needs CAP_SYS_NICE, or `@realtime - rtprio 98` in /etc/security/limits.conf",
            ),
        },
        Privilege {
            name: "memory lock",
            granted: lock,
            note: say(
                lock,
                "all pages stay in memory".to_owned(),
                "needs CAP_IPC_LOCK, or `@realtime - memlock unlimited` in /etc/security/limits.conf",
            ),
        },
        Privilege {
            name: "no deep idle",
            granted: idle,
            note: say(
                idle,
                "/dev/cpu_dma_latency held at 0".to_owned(),
                "needs write access to /dev/cpu_dma_latency (a udev rule: KERNEL==\"cpu_dma_latency\", GROUP=\"realtime\", MODE=\"0660\")",
            ),
        },
    ]
}

/// Page faults of the calling thread so far, minor and major together.
#[must_use]
pub fn page_faults() -> u64 {
    // SAFETY: all-zero bytes are a valid `rusage`, which holds numbers only.
    let mut usage: libc::rusage = unsafe { core::mem::zeroed() };
    // SAFETY: `usage` lives through the call and is of the type it fills.
    let done = unsafe { libc::getrusage(libc::RUSAGE_THREAD, &raw mut usage) } == 0;
    if done { (usage.ru_minflt + usage.ru_majflt) as u64 } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_privilege_is_named_and_says_what_it_lacks() {
        let list = privileges(80);
        assert_eq!(list.len(), 3);
        assert!(list.iter().all(|p| !p.note.is_empty() && (p.granted || p.note.contains("needs"))));
    }

    #[test]
    fn runs_beside_each_other_get_cores_of_their_own_as_long_as_there_are_some() {
        let cores = rustix::thread::sched_getaffinity(None).map(|set| set.count() as usize).unwrap_or(1);
        let given: std::collections::BTreeSet<_> = (0..cores).filter_map(shared_core).collect();
        assert_eq!(given.len(), cores);
        assert_eq!(shared_core(0), shared_core(cores));
    }

    #[test]
    fn page_faults_count_up() {
        let before = page_faults();
        let memory = vec![1_u8; 64 << 20];
        std::hint::black_box(&memory);
        assert!(page_faults() > before);
    }
}
