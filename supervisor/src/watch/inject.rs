//! Fault injection: faults of the scenario at their ticks, and faults that an operator requests.
//!
//! Faults of the operating system are real: signals, busy processes on every core, a full disk, a limit on locked
//! memory. A fault in messages is published before its tick, and the process itself applies it.

use super::slot::ProcessSlot;
use crate::children::this_program;
use crate::reaper;
use anyhow::{Context, Result, bail};
use hapfic_config::{Fault, FaultKind, FaultTarget};
use hapfic_ipc::SharedStatus;
use hapfic_ipc::{IpcError, Output, SupervisorRecord};
use hapfic_messages::{Injection, MessageFault, Process};
use rustix::process::{Pid, Resource, Rlimit, Signal, prlimit};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::sync::atomic::Ordering;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

/// Ticks by which a fault in messages is published before its tick.
const PUBLISH_LEAD_TICKS: i64 = 100;
/// Faults in messages published at a time: a process reads one fault per tick.
const PUBLISHED_AT_A_TIME: usize = 4;
/// Largest file system that a fault may fill [bytes]: a file system made for the purpose.
const MAX_DISK_BYTES: u64 = 256 << 20;
/// Limit of locked memory under the fault `memory_lock` [bytes].
const MEMORY_LOCK_LIMIT: u64 = 64 << 10;

/// A fault, and its index in the scenario; `None`: an operator has requested it.
type Indexed = (Option<usize>, Fault);

/// The faults of a run.
pub struct Injections<'a> {
    /// What outlives this supervisor.
    record: &'a SupervisorRecord,
    /// Future faults of the operating system, in the order of time.
    system: VecDeque<Indexed>,
    /// Due or requested faults of the operating system that wait for their processes.
    due: Vec<Indexed>,
    /// Faults in messages not published yet, in the order of time.
    message: VecDeque<Indexed>,
    /// Published faults in messages before their tick.
    upcoming: Vec<Fault>,
    requests: Receiver<Fault>,
    output: Output<Injection>,
    /// Published injections that may still be in the future.
    published: Vec<Injection>,
    /// Halted processes, their generations, and the times at which they continue.
    halted: Vec<(Process, u32, Instant)>,
    stressors: Vec<Child>,
    /// File with which a fault fills the disk of the log.
    filler: PathBuf,
}

/// Returns the fault in messages that a fault specifies, if any.
fn message_fault(kind: FaultKind) -> Option<MessageFault> {
    Some(match kind {
        FaultKind::Slow => MessageFault::Slow,
        FaultKind::Drop => MessageFault::Drop,
        FaultKind::Repeat => MessageFault::Repeat,
        FaultKind::Corrupt => MessageFault::Corrupt,
        FaultKind::Nan => MessageFault::Nan,
        FaultKind::Stale => MessageFault::Stale,
        _ => return None,
    })
}

/// Returns the processes that a fault affects.
fn targets(target: FaultTarget) -> &'static [Process] {
    match target {
        FaultTarget::Plant => &[Process::Plant],
        FaultTarget::Planner => &[Process::Planner],
        FaultTarget::Controller => &[Process::Controller],
        FaultTarget::Standby => &[Process::Standby],
        FaultTarget::Controllers => &[Process::Controller, Process::Standby],
        FaultTarget::Supervisor => &[Process::Supervisor],
        FaultTarget::Gate => &[Process::Gate],
        FaultTarget::SpareGate => &[Process::SpareGate],
        FaultTarget::Recorder => &[Process::Recorder],
        FaultTarget::Machine => &[],
    }
}

/// Checks that machine and run allow the faults of a scenario.
///
/// # Errors
/// The first fault that they do not allow.
pub fn check(faults: &[Fault], log: &Path, standby: bool) -> Result<()> {
    for fault in faults {
        possible(fault, log, standby)?;
    }
    Ok(())
}

/// Checks that machine and run allow a fault.
///
/// # Errors
/// The reason if they do not allow it.
pub fn possible(fault: &Fault, log: &Path, standby: bool) -> Result<()> {
    let name = fault.kind.name();
    if !standby && matches!(fault.target, FaultTarget::Standby | FaultTarget::Controllers) {
        bail!("fault '{name}' of process '{}': found no standby, expected supervisor.standby = true", fault.target.name());
    }
    if fault.kind == FaultKind::FullDisk {
        // The log's folder is created later, in the nearest existing one.
        let folder = log.ancestors().skip(1).find(|f| f.is_dir()).unwrap_or(Path::new("."));
        let fs = rustix::fs::statfs(folder).with_context(|| format!("fault '{name}': cannot examine {}", folder.display()))?;
        let size = fs.f_blocks as u64 * fs.f_bsize as u64;
        let tmpfs = fs.f_type as u64 == 0x0102_1994;
        if !tmpfs || size > MAX_DISK_BYTES {
            bail!(
                "fault '{name}': the log's folder {} is on a {} of {} MB, expected a tmpfs of its own of at most {} MB, since \
                 the fault fills it. Hint: mount -t tmpfs -o size=8m tmpfs DIR",
                folder.display(),
                if tmpfs { "tmpfs" } else { "disk" },
                size >> 20,
                MAX_DISK_BYTES >> 20
            );
        }
    }
    Ok(())
}

/// Describes a fault.
pub fn describe(fault: &Fault) -> String {
    let mut text = format!("{} {}", fault.kind.name(), fault.target.name());
    if fault.ticks > 0 {
        text.push_str(&format!(" for {} ms", fault.ticks));
    }
    if fault.by_us > 0 {
        text.push_str(&format!(" by {} us", fault.by_us));
    }
    text
}

impl<'a> Injections<'a> {
    /// Creates the faults of a run from its scenario, without those that a lost supervisor has injected, and a channel for
    /// requested faults. `gated` is the tick of the last command.
    pub fn new(
        faults: &[Fault],
        requests: Receiver<Fault>,
        output: Output<Injection>,
        log: &Path,
        record: &'a SupervisorRecord,
        gated: i64,
    ) -> Self {
        // Published by a lost supervisor, and still to come.
        let published = faults.iter().copied().enumerate().filter(|(index, f)| record.is_injected(*index) && f.tick > gated + 1);
        let upcoming = published.map(|(_, f)| f).filter(|f| message_fault(f.kind).is_some()).collect();
        let left = faults.iter().copied().enumerate().filter(|(index, _)| !record.is_injected(*index));
        let (message, system) = left.map(|(index, f)| (Some(index), f)).partition(|(_, f)| message_fault(f.kind).is_some());
        Self {
            system,
            due: Vec::new(),
            message,
            upcoming,
            requests,
            output,
            published: Vec::new(),
            halted: Vec::new(),
            stressors: Vec::new(),
            filler: log.with_extension("filler"),
            record,
        }
    }

    /// Whether a fault is near, so that the supervisor should poll fast.
    #[must_use]
    pub fn near(&self, gated: i64, within: i64) -> bool {
        let soon = |faults: &VecDeque<Indexed>| faults.front().is_some_and(|(_, f)| f.tick <= gated + within);
        !self.halted.is_empty() || !self.due.is_empty() || !self.upcoming.is_empty() || soon(&self.system) || soon(&self.message)
    }

    /// Injects the due faults. Returns them with their descriptions.
    ///
    /// # Errors
    /// If a fault that was checked cannot be injected.
    pub fn act(&mut self, slots: &mut [ProcessSlot], shared: &SharedStatus, gated: i64) -> Result<Vec<(Fault, String)>> {
        let mut done = Vec::new();
        self.resume_halted(slots);
        while let Ok(fault) = self.requests.try_recv() {
            match message_fault(fault.kind) {
                Some(message_fault) => {
                    self.publish(&fault, message_fault, gated + 1)?;
                    self.upcoming.push(Fault { tick: gated + 1, ..fault });
                }
                None => self.due.push((None, fault)),
            }
        }
        for _ in 0..PUBLISHED_AT_A_TIME {
            let Some((index, fault)) = self.message.pop_front_if(|(_, f)| f.tick <= gated + PUBLISH_LEAD_TICKS) else { break };
            self.note_injected(index);
            if let Some(message_fault) = message_fault(fault.kind) {
                self.publish(&fault, message_fault, fault.tick)?;
                self.upcoming.push(fault);
            }
        }
        // Reported at its tick, not when it is published.
        self.upcoming.retain(|fault| {
            let later = fault.tick > gated + 1;
            if !later {
                done.push((*fault, describe(fault)));
            }
            later
        });
        while let Some(fault) = self.system.pop_front_if(|(_, f)| f.tick <= gated + 1) {
            self.due.push(fault);
        }
        self.record.injected.fetch_add(done.len() as u64, Ordering::Relaxed);
        // A fault waits until its processes do ticks; the other faults do not wait for it.
        for (index, fault) in std::mem::take(&mut self.due) {
            if ready(&fault, slots, shared) {
                // Before: it may end this process.
                self.note_injected(index);
                self.record.injected.fetch_add(1, Ordering::Relaxed);
                self.apply(&fault, slots)?;
                done.push((fault, describe(&fault)));
            } else {
                self.due.push((index, fault));
            }
        }
        Ok(done)
    }

    /// Notes that a fault of the scenario is injected.
    fn note_injected(&self, index: Option<usize>) {
        if let Some(index) = index {
            self.record.set_injected(index);
        }
    }

    fn publish(&mut self, fault: &Fault, message_fault: MessageFault, tick: i64) -> Result<(), IpcError> {
        for process in targets(fault.target) {
            let injection = Injection {
                number: self.record.injection.fetch_add(1, Ordering::Relaxed) + 1,
                tick,
                ticks: fault.ticks,
                process: process.code(),
                message_fault: message_fault.code(),
                by_us: fault.by_us,
            };
            self.output.send(&injection)?;
            self.output.preloan();
            self.published.push(injection);
        }
        Ok(())
    }

    /// Republishes the future faults in messages of a restarted process.
    ///
    /// # Errors
    /// If publishing fails.
    pub fn republish(&mut self, process: Process, gated: i64) -> Result<(), IpcError> {
        self.published.retain(|injection| injection.tick > gated + 1);
        for injection in self.published.iter().filter(|injection| injection.process == process.code()) {
            self.output.send(injection)?;
            self.output.preloan();
        }
        Ok(())
    }

    fn apply(&mut self, fault: &Fault, slots: &mut [ProcessSlot]) -> Result<()> {
        let until = Instant::now() + Duration::from_millis(fault.ticks.into());
        match fault.kind {
            FaultKind::Hog => {
                for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
                    self.start_stressor(&["hog", &fault.ticks.to_string()])?;
                }
            }
            FaultKind::FullDisk => {
                self.record.filled.store(1, Ordering::Relaxed);
                let filler = self.filler.to_string_lossy().into_owned();
                self.start_stressor(&["fill", &filler])?;
            }
            // It cannot continue by itself.
            FaultKind::Stop if fault.target == FaultTarget::Supervisor => {
                self.start_stressor(&["halt", &fault.ticks.to_string()])?
            }
            FaultKind::Kill if fault.target == FaultTarget::Supervisor => {
                // Ends this process.
                let _ = rustix::process::kill_process(rustix::process::getpid(), Signal::KILL);
            }
            kind => {
                for slot in slots.iter_mut().filter(|s| targets(fault.target).contains(&s.process)) {
                    let Some(child) = &slot.child else { continue };
                    match kind {
                        FaultKind::Kill => {
                            child.signal(Signal::KILL);
                            slot.kill_pending = true;
                        }
                        FaultKind::Stop => {
                            child.signal(Signal::STOP);
                            self.halted.push((slot.process, slot.generation, until));
                        }
                        FaultKind::MemoryLock => {
                            let limit = Rlimit { current: Some(MEMORY_LOCK_LIMIT), maximum: Some(MEMORY_LOCK_LIMIT) };
                            prlimit(Some(child.pid()), Resource::Memlock, limit).context("cannot limit locked memory")?;
                        }
                        _ => {}
                    }
                }
            }
        }
        Ok(())
    }

    /// Continues halted processes at the end of their time.
    fn resume_halted(&mut self, slots: &[ProcessSlot]) {
        let now = Instant::now();
        self.halted.retain(|(process, generation, until)| {
            let same = slots.iter().find(|s| s.process == *process && s.generation == *generation && s.child.is_some());
            if now < *until {
                return same.is_some();
            }
            if let Some(child) = same.and_then(|s| s.child.as_ref()) {
                child.signal(Signal::CONT);
            }
            false
        });
        self.stressors.retain(|stressor| matches!(reaper::exit_status(Pid::from_child(stressor)), Ok(None)));
    }

    /// Starts this program as a stressor.
    fn start_stressor(&mut self, arguments: &[&str]) -> Result<()> {
        let child = this_program()?
            .arg("stressor")
            .arg(std::process::id().to_string())
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .context("cannot start a stressor")?;
        self.stressors.push(child);
        Ok(())
    }
}

impl Drop for Injections<'_> {
    fn drop(&mut self) {
        for stressor in &mut self.stressors {
            // Fails only if it has ended already.
            let _ = stressor.kill();
            let _ = stressor.wait();
        }
        if self.record.filled.load(Ordering::Relaxed) != 0 {
            let _ = std::fs::remove_file(&self.filler);
        }
    }
}

/// Whether all processes that a fault affects do ticks.
fn ready(fault: &Fault, slots: &[ProcessSlot], shared: &SharedStatus) -> bool {
    targets(fault.target).iter().all(|process| {
        *process == Process::Supervisor
            || slots.iter().any(|slot| slot.process == *process && slot.ticks(shared) && !slot.kill_pending)
    })
}
