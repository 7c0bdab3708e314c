//! Real-time set-up of a thread and of the machine: takes the granted privileges and reports the others.

use crate::memory;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, CpuSet};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

/// Real-time privileges of a thread: a bit set that travels in [`hapfic_messages::Timing`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SchedGrants(pub u32);

impl SchedGrants {
    /// The scheduler `SCHED_FIFO` at the requested priority.
    pub const FIFO: u32 = 1;
    /// All memory of the process is locked.
    pub const LOCKED: u32 = 2;
    /// The thread stays on the requested core.
    pub const PINNED: u32 = 4;

    /// Whether a bit is set.
    #[must_use]
    pub fn has(self, bit: u32) -> bool {
        self.0 & bit != 0
    }
}

/// Real-time privileges that a thread requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SchedRequest {
    /// Priority of `SCHED_FIFO`, 1 to 98.
    pub priority: i32,
    /// Core to stay on.
    pub core: Option<usize>,
}

impl SchedRequest {
    /// Request of a priority, and of a core or any.
    #[must_use]
    pub fn new(priority: u32, core: Option<u32>) -> Self {
        Self { priority: priority as i32, core: core.map(|c| c as usize) }
    }
}

/// Core for the real-time threads of a run: the last core that this process may use for `index` 0, the core before it
/// for the next `index`, and so on, cyclically.
#[must_use]
pub fn shared_core(index: usize) -> Option<u32> {
    let allowed = usable_cores();
    let place = allowed.len().checked_sub(1 + index % allowed.len().max(1))?;
    allowed.get(place).map(|core| *core as u32)
}

/// Cores that this process may use, ascending; empty if the system does not report them.
#[must_use]
pub fn usable_cores() -> Vec<usize> {
    let Ok(set) = rustix::thread::sched_getaffinity(None) else { return Vec::new() };
    (0..CpuSet::MAX_CPU).filter(|core| set.is_set(*core)).collect()
}

/// Stack that is prefaulted, so that a deep call does not fault [bytes].
const STACK: usize = 256 * 1024;

/// Stack for a small real-time thread [bytes]: more than what is prefaulted.
pub const SMALL_STACK: usize = 2 * STACK;

/// Core for the standby controller: another than the run's shared core, if there is one.
///
/// A dying process frees its memory at its own priority, on its own core. A controller that takes over immediately must
/// not queue behind it.
#[must_use]
pub fn standby_core(index: usize) -> Option<u32> {
    shared_core(index + 1)
}

/// Applies a request to the calling thread, as far as the system grants it; [`lock_memory`] locks memory beforehand.
///
/// Does not fail: a privilege that is not granted is not in the result.
#[must_use]
pub fn apply_to_current_thread(request: SchedRequest) -> SchedGrants {
    memory::prefault_heap();
    apply_without_heap(request)
}

/// Applies a request to the calling thread, which does not allocate.
#[must_use]
pub(crate) fn apply_without_heap(request: SchedRequest) -> SchedGrants {
    let mut granted = 0;
    if MEMORY_LOCKED.load(Ordering::Relaxed) {
        granted |= SchedGrants::LOCKED;
    }
    touch_stack();
    if let Some(core) = request.core
        && pin(None, core).is_ok()
    {
        granted |= SchedGrants::PINNED;
    }
    if try_set_fifo(request.priority) {
        granted |= SchedGrants::FIFO;
    }
    SchedGrants(granted)
}

fn try_set_fifo(priority: i32) -> bool {
    let parameters = libc::sched_param { sched_priority: priority };
    // SAFETY: `parameters` lives through the call; 0 names the calling thread.
    unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameters) == 0 }
}

/// Gives the calling thread a priority of `SCHED_FIFO`, 1 to 98, which its child threads and processes do not inherit.
///
/// # Errors
/// If the system rejects the call.
pub fn set_fifo(priority: u32) -> std::io::Result<()> {
    // 0 names the calling thread.
    set_scheduler(0, libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, priority)
}

fn set_scheduler(pid: i32, policy: i32, priority: u32) -> std::io::Result<()> {
    let parameters = libc::sched_param { sched_priority: priority as i32 };
    // SAFETY: `parameters` lives through the call.
    let done = unsafe { libc::sched_setscheduler(pid, policy, &raw const parameters) };
    if done == 0 { Ok(()) } else { Err(std::io::Error::last_os_error()) }
}

/// Pins a process's main thread, or the calling thread, to a core.
///
/// # Errors
/// If there is no such core, or the system rejects the call.
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
/// If the system rejects the call.
pub fn set_priority_of(pid: rustix::process::Pid, priority: u32) -> std::io::Result<()> {
    set_scheduler(pid.as_raw_nonzero().get(), libc::SCHED_FIFO, priority)
}

/// The same, but the threads and processes that it starts do not inherit it.
///
/// # Errors
/// If the system rejects the call.
pub fn set_own_priority_of(pid: rustix::process::Pid, priority: u32) -> std::io::Result<()> {
    set_scheduler(pid.as_raw_nonzero().get(), libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, priority)
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

/// Gives up the rights to real-time scheduling and to locked memory, for the calling thread, its later threads and its
/// children. The process keeps working if the system rejects a call: it never asks for what it gives up.
pub fn give_up_privileges() {
    let none = rustix::process::Rlimit { current: Some(0), maximum: Some(0) };
    for limit in [Resource::Rtprio, Resource::Memlock] {
        let _ = rustix::process::setrlimit(limit, none);
    }
    if let Ok(mut sets) = rustix::thread::capabilities(None) {
        let given_up = CapabilitySet::SYS_NICE | CapabilitySet::IPC_LOCK | CapabilitySet::SYS_RESOURCE;
        for set in [&mut sets.effective, &mut sets.permitted, &mut sets.inheritable] {
            set.remove(given_up);
        }
        let _ = rustix::thread::set_capabilities(None, sets);
    }
}

/// How much memory [`lock_memory`] prefaults.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Prefault {
    /// All current memory. For the supervisor: its pages of the program's file stay in memory for all processes of the
    /// stack, which then never wait for a disk.
    All,
    /// The code, and what is in use. For the other processes.
    Used,
}

/// Locks all memory of the process, now and in future: a used page stays. To be called before topics are opened.
///
/// A process uses only a part of the program's code, and of a topic's segment, which holds the deepest queue of every
/// possible subscriber. Prefaulting all of it would stall a mapping thread, in the middle of a tick, for as long
/// as a tick. A process that dies at real-time priority would free all of it before any thread of lower priority runs
/// again. So this call enables prefaulting of what can be in use, and of nothing else: code, a heap reserve, the
/// messages in flight.
///
/// Locks nothing under a finite limit: a later allocation would fail there, and abort the process.
pub fn lock_memory(prefault: Prefault) {
    let used = MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT;
    let all = || mlockall(MlockAllFlags::CURRENT).and_then(|()| mlockall(MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT));
    let locked = may_lock()
        && match prefault {
            Prefault::All => all().is_ok(),
            Prefault::Used => mlockall(used).is_ok(),
        };
    MEMORY_LOCKED.store(locked, Ordering::Relaxed);
    // Also without the lock: the pages then stay until memory runs short.
    memory::enable();
    if prefault == Prefault::Used {
        memory::prefault_code();
    }
}

/// Reserves `count` entries in the process's table of open files, or as many as its limit allows. To be called before
/// the process has threads.
///
/// The kernel doubles a full table. If threads share the table, the thread that exceeds it waits some 10 ms, on a loaded
/// machine up to 13 s, until all processors have passed a quiescent state (`synchronize_rcu`). The gate did so when it connected to the
/// first restarted process.
///
/// # Errors
/// If the system rejects the call; the table then grows on demand.
pub fn reserve_fd_table(count: u64) -> std::io::Result<()> {
    let may_have = getrlimit(Resource::Nofile).current.unwrap_or(u64::MAX);
    let last = count.min(may_have).saturating_sub(1);
    let file = File::open("/dev/null")?;
    // The table keeps its size.
    drop(rustix::io::fcntl_dupfd_cloexec(&file, i32::try_from(last).unwrap_or(i32::MAX))?);
    Ok(())
}

/// Whether the process has locked its memory.
static MEMORY_LOCKED: AtomicBool = AtomicBool::new(false);

fn may_lock() -> bool {
    getrlimit(Resource::Memlock).current.is_none() || capable(CapabilitySet::IPC_LOCK)
}

/// Whether a thread of this process gets `SCHED_FIFO` at a priority. Tries it: rights alone do not suffice in a control
/// group without real-time runtime.
#[must_use]
pub fn may_fifo(priority: i32) -> bool {
    let tried = std::thread::Builder::new().name("hapfic-may-fifo".to_owned()).spawn(move || set_fifo(priority as u32).is_ok());
    tried.is_ok_and(|thread| thread.join().unwrap_or(false))
}

/// Whether this process has the right to a priority, whatever its control group gives.
fn may_rise(priority: i32) -> bool {
    let limit = getrlimit(Resource::Rtprio).current;
    capable(CapabilitySet::SYS_NICE) || limit.is_none_or(|most| most >= u64::from(priority.unsigned_abs()))
}

/// Guard that keeps the processors out of idle states with a long exit latency.
#[derive(Debug)]
pub struct CpuLatencyGuard(#[allow(dead_code)] File);

/// File that takes the requested longest exit latency.
const DMA_LATENCY: &str = "/dev/cpu_dma_latency";

impl CpuLatencyGuard {
    /// Requests zero exit latency; `None` if this user may not.
    #[must_use]
    pub fn take() -> Option<Self> {
        let mut file = OpenOptions::new().write(true).open(DMA_LATENCY).ok()?;
        file.write_all(&0_i32.to_ne_bytes()).ok()?;
        Some(Self(file))
    }
}

/// Privilege that real time needs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Privilege {
    /// Its name.
    pub name: &'static str,
    /// Whether this process may have it.
    pub granted: bool,
    /// The value found, or the remedy.
    pub note: String,
}

/// Privileges of this process, for the highest priority that it will request.
#[must_use]
pub fn privileges(priority: i32) -> Vec<Privilege> {
    let fifo = may_fifo(priority);
    let lock = may_lock();
    let idle = OpenOptions::new().write(true).open(DMA_LATENCY).is_ok();
    let note = |ok: bool, yes: String, no: &str| if ok { yes } else { no.to_owned() };
    vec![
        Privilege {
            name: "SCHED_FIFO",
            granted: fifo,
            note: note(
                fifo,
                format!("priority up to {priority}"),
                if may_rise(priority) {
                    "has the right, but not the processor time: the control group has no real-time runtime (cpu.rt_runtime_us)"
                } else {
                    "needs CAP_SYS_NICE, or `@realtime - rtprio 98` in /etc/security/limits.conf"
                },
            ),
        },
        Privilege {
            name: "memory lock",
            granted: lock,
            note: note(
                lock,
                "all pages stay in memory".to_owned(),
                "needs CAP_IPC_LOCK, or `@realtime - memlock unlimited` in /etc/security/limits.conf",
            ),
        },
        Privilege {
            name: "no deep idle",
            granted: idle,
            note: note(
                idle,
                "/dev/cpu_dma_latency held at 0".to_owned(),
                "needs write access to /dev/cpu_dma_latency (a udev rule: KERNEL==\"cpu_dma_latency\", GROUP=\"realtime\", MODE=\"0660\")",
            ),
        },
    ]
}

/// Page faults of the calling thread so far, minor and major.
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
    fn privileges_without_grant_name_remedy() {
        let list = privileges(80);
        assert_eq!(list.len(), 3);
        assert!(list.iter().all(|p| !p.note.is_empty() && (p.granted || p.note.contains("needs"))));
    }

    #[test]
    fn shared_core_each_index_gets_own_core() {
        let cores = rustix::thread::sched_getaffinity(None).map(|set| set.count() as usize).unwrap_or(1);
        let given: std::collections::BTreeSet<_> = (0..cores).filter_map(shared_core).collect();
        assert_eq!(given.len(), cores);
        assert_eq!(shared_core(0), shared_core(cores));
    }

    #[test]
    fn page_faults_new_memory_increases_count() {
        let before = page_faults();
        let memory = vec![1_u8; 64 << 20];
        std::hint::black_box(&memory);
        assert!(page_faults() > before);
    }
}
