//! Faults on purpose: those of the scenario at their ticks, and those that an operator asks for.
//!
//! What the operating system does to processes is done to them in earnest: signals, hogs on every core, a full disk, a limit on
//! locked memory. What a process does wrong in its messages it is told ahead of the tick.

use super::slot::ProcessSlot;
use crate::children::this_program;
use anyhow::{Context, Result, bail};
use hapfic_config::{Fault, FaultKind, FaultTarget};
use hapfic_gate_process::shared_status::SharedStatus;
use hapfic_ipc::{IpcError, Output};
use hapfic_messages::{Injection, Process, Tampering};
use rustix::process::{Resource, Rlimit, Signal, prlimit};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

/// Ticks by which a process is told ahead of a fault in its messages, and how many it is told of at a time: it looks once a tick.
const AHEAD: i64 = 100;
const AT_A_TIME: usize = 4;
/// Largest file system that is filled up, bytes: only one that was made for it.
const LARGEST_DISK: u64 = 256 << 20;
/// Bytes of memory a process may lock when that is exhausted.
const LITTLE_MEMORY: u64 = 64 << 10;

/// The faults of a run.
pub struct Injections {
    /// Signals, limits and hogs still to come, in the action of time.
    outer: VecDeque<Fault>,
    /// Those whose time has come, or that were asked for, and that wait for somebody to be there.
    due: Vec<Fault>,
    /// Faults in messages that have not been told of yet, in the action of time.
    inner: VecDeque<Fault>,
    /// Those that were told of and whose tick has not come.
    coming: Vec<Fault>,
    asked: Receiver<Fault>,
    output: Output<Injection>,
    /// Faults in messages that were told of and may still be to come.
    told: Vec<Injection>,
    number: u64,
    /// Halted processes, and when they go on.
    halted: Vec<(Process, u32, Instant)>,
    helpers: Vec<Child>,
    log: PathBuf,
    filler: Option<PathBuf>,
    /// Done so far.
    pub done: u64,
}

/// What a fault does wrong in messages, if it does.
fn tampering(kind: FaultKind) -> Option<Tampering> {
    Some(match kind {
        FaultKind::Slow => Tampering::Slow,
        FaultKind::Drop => Tampering::Drop,
        FaultKind::Repeat => Tampering::Repeat,
        FaultKind::Corrupt => Tampering::Corrupt,
        FaultKind::Nan => Tampering::Nan,
        FaultKind::Stale => Tampering::Stale,
        _ => return None,
    })
}

/// The processes a fault happens to.
fn targets(target: FaultTarget) -> &'static [Process] {
    match target {
        FaultTarget::Plant => &[Process::Plant],
        FaultTarget::Planner => &[Process::Planner],
        FaultTarget::Controller => &[Process::Controller],
        FaultTarget::Standby => &[Process::Standby],
        FaultTarget::Controllers => &[Process::Controller, Process::Standby],
        FaultTarget::Supervisor => &[Process::Supervisor],
        FaultTarget::Machine => &[],
    }
}

/// Checks what a scenario's faults need of the machine and of the run.
///
/// # Errors
/// What cannot be done here.
pub fn check(faults: &[Fault], log: &Path, standby: bool) -> Result<()> {
    for fault in faults {
        possible(fault, log, standby)?;
    }
    Ok(())
}

/// Whether a fault can be made here.
///
/// # Errors
/// Why not.
pub fn possible(fault: &Fault, log: &Path, standby: bool) -> Result<()> {
    let name = fault.kind.name();
    if !standby && matches!(fault.target, FaultTarget::Standby | FaultTarget::Controllers) {
        bail!("fault '{name}' of process '{}': found no standby, expected supervisor.standby = true", fault.target.name());
    }
    if fault.kind == FaultKind::FullDisk {
        // The log's folder is made later, in the nearest one that is there.
        let folder = log.ancestors().skip(1).find(|f| f.is_dir()).unwrap_or(Path::new("."));
        let fs = rustix::fs::statfs(folder).with_context(|| format!("fault '{name}': cannot look at {}", folder.display()))?;
        let size = fs.f_blocks as u64 * fs.f_bsize as u64;
        let tmpfs = fs.f_type as u64 == 0x0102_1994;
        if !tmpfs || size > LARGEST_DISK {
            bail!(
                "fault '{name}': the log's folder {} is on a {} of {} MB, expected a tmpfs of its own of at most {} MB, since it is filled \
                 up. Hint: mount -t tmpfs -o size=8m tmpfs DIR",
                folder.display(),
                if tmpfs { "tmpfs" } else { "disk" },
                size >> 20,
                LARGEST_DISK >> 20
            );
        }
    }
    Ok(())
}

/// What a fault does, in words.
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

impl Injections {
    /// Those of a scenario, and a way in for others.
    pub fn new(faults: &[Fault], asked: Receiver<Fault>, output: Output<Injection>, log: &Path) -> Self {
        let (inner, outer) = faults.iter().copied().partition(|f| tampering(f.kind).is_some());
        Self {
            outer,
            due: Vec::new(),
            inner,
            coming: Vec::new(),
            asked,
            output,
            told: Vec::new(),
            number: 0,
            halted: Vec::new(),
            helpers: Vec::new(),
            log: log.to_owned(),
            filler: None,
            done: 0,
        }
    }

    /// Whether something happens soon, so that the supervisor should look more often.
    #[must_use]
    pub fn near(&self, gated: i64, within: i64) -> bool {
        let soon = |faults: &VecDeque<Fault>| faults.front().is_some_and(|f| f.tick <= gated + within);
        !self.halted.is_empty() || !self.due.is_empty() || !self.coming.is_empty() || soon(&self.outer) || soon(&self.inner)
    }

    /// Does what is due. Returns what was done, in words, and to whom.
    ///
    /// # Errors
    /// If something that should be possible is not.
    pub fn act(&mut self, slots: &mut [ProcessSlot], shared: &SharedStatus, gated: i64) -> Result<Vec<(Fault, String)>> {
        let mut done = Vec::new();
        self.wake(slots);
        while let Ok(fault) = self.asked.try_recv() {
            match tampering(fault.kind) {
                Some(tampering) => {
                    self.instruct(&fault, tampering, gated + 1)?;
                    self.coming.push(Fault { tick: gated + 1, ..fault });
                }
                None => self.due.push(fault),
            }
        }
        for _ in 0..AT_A_TIME {
            let Some(fault) = self.inner.pop_front_if(|f| f.tick <= gated + AHEAD) else { break };
            if let Some(tampering) = tampering(fault.kind) {
                self.instruct(&fault, tampering, fault.tick)?;
                self.coming.push(fault);
            }
        }
        // Told of when it happens, not when it is arranged.
        self.coming.retain(|fault| {
            let later = fault.tick > gated + 1;
            if !later {
                done.push((*fault, describe(fault)));
            }
            later
        });
        while let Some(fault) = self.outer.pop_front_if(|f| f.tick <= gated + 1) {
            self.due.push(fault);
        }
        // Whoever is not there yet cannot be hit: it is, as soon as it is there; others need not wait for that.
        for fault in std::mem::take(&mut self.due) {
            if ready(&fault, slots, shared) {
                self.happen(&fault, slots)?;
                done.push((fault, describe(&fault)));
            } else {
                self.due.push(fault);
            }
        }
        self.done += done.len() as u64;
        Ok(done)
    }

    fn instruct(&mut self, fault: &Fault, tampering: Tampering, tick: i64) -> Result<(), IpcError> {
        for process in targets(fault.target) {
            self.number += 1;
            let told = Injection {
                number: self.number,
                tick,
                ticks: fault.ticks,
                process: process.code(),
                tampering: tampering.code(),
                by_us: fault.by_us,
            };
            self.output.send(&told)?;
            self.output.preloan();
            self.told.push(told);
        }
        Ok(())
    }

    /// Tells a process that was started again of the faults that are still to come.
    ///
    /// # Errors
    /// If it cannot be told.
    pub fn republish(&mut self, process: Process, gated: i64) -> Result<(), IpcError> {
        self.told.retain(|told| told.tick > gated + 1);
        for told in self.told.iter().filter(|told| told.process == process.code()) {
            self.output.send(told)?;
            self.output.preloan();
        }
        Ok(())
    }

    fn happen(&mut self, fault: &Fault, slots: &mut [ProcessSlot]) -> Result<()> {
        let until = Instant::now() + Duration::from_millis(fault.ticks.into());
        match fault.kind {
            FaultKind::Hog => {
                for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
                    self.helper(&["hog", &fault.ticks.to_string()])?;
                }
            }
            FaultKind::FullDisk => {
                let filler = self.log.with_extension("filler");
                self.helper(&["fill", &filler.to_string_lossy()])?;
                self.filler = Some(filler);
            }
            FaultKind::Kill if fault.target == FaultTarget::Supervisor => {
                // Nothing after this happens.
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
                            let little = Rlimit { current: Some(LITTLE_MEMORY), maximum: Some(LITTLE_MEMORY) };
                            prlimit(Some(child.pid()), Resource::Memlock, little).context("cannot limit locked memory")?;
                        }
                        _ => {}
                    }
                }
            }
        }
        Ok(())
    }

    /// Lets those go on that have been halted long enough.
    fn wake(&mut self, slots: &[ProcessSlot]) {
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
        self.helpers.retain_mut(|helper| matches!(helper.try_wait(), Ok(None)));
    }

    /// Starts this program as something that is in everybody's way.
    fn helper(&mut self, arguments: &[&str]) -> Result<()> {
        let child = this_program()?
            .arg("nuisance")
            .arg(std::process::id().to_string())
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .context("cannot start what is to be in the way")?;
        self.helpers.push(child);
        Ok(())
    }
}

impl Drop for Injections {
    fn drop(&mut self) {
        for helper in &mut self.helpers {
            // Gone already is as good.
            let _ = helper.kill();
            let _ = helper.wait();
        }
        if let Some(filler) = &self.filler {
            let _ = std::fs::remove_file(filler);
        }
    }
}

/// Whether all that a fault should hit are there.
fn ready(fault: &Fault, slots: &[ProcessSlot], shared: &SharedStatus) -> bool {
    targets(fault.target).iter().all(|process| {
        *process == Process::Supervisor
            || slots.iter().any(|slot| slot.process == *process && slot.ticks(shared) && !slot.kill_pending)
    })
}
