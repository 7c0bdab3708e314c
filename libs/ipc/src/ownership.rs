//! Ownership of a process by a run: a supervisor that lives, or comes within the grace time.
//!
//! A supervisor that is lost has a successor, which the launcher starts. Until then the processes go on. A supervisor that is
//! only late, halted, or still starting, owns them. If no successor comes within the grace time, the gates let the drive brake, and half
//! a second later every process ends.

use crate::error::IpcError;
use crate::run::RunFile;
use crate::supervisor_page::SupervisorPage;
use core::sync::atomic::Ordering;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Pid, PidfdFlags, Signal, getppid, pidfd_open, set_parent_process_death_signal};
use std::os::fd::OwnedFd;

/// Age of the supervisor's heartbeat from which its process is looked at [ns].
const FRESH_NS: u64 = 200_000_000;
/// Interval of these looks, each a system call [ns].
const LOOK_INTERVAL_NS: u64 = 50_000_000;
/// Time from the end of the grace time to the end of the gates, and of all others [ns].
const GATES_END_NS: u64 = 500_000_000;
const OTHERS_END_NS: u64 = 1_000_000_000;

/// Ends this process when the thread that started it ends: a helper, a stressor, or a part of a measurement.
///
/// # Errors
/// If the system rejects the call, or the parent has already ended: the kernel signals later deaths only.
pub fn tie_to_parent(pid: i32) -> std::io::Result<()> {
    set_parent_process_death_signal(Some(Signal::KILL))?;
    if parent() == Some(pid) { Ok(()) } else { Err(std::io::Error::other("the process that started it has ended")) }
}

fn parent() -> Option<i32> {
    getppid().map(|parent| parent.as_raw_nonzero().get())
}

/// What a run without a supervisor means for a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Orphanhood {
    /// The run has a supervisor, or may still get one.
    Owned,
    /// The grace time is over: the drive has to brake.
    Brake,
    /// The gates have to end.
    GatesEnd,
    /// All others have to end.
    AllEnd,
}

/// A process's view of the run's supervisor.
#[derive(Debug)]
pub struct Ownership {
    page: SupervisorPage,
    grace_ns: u64,
    /// Process id and handle of the supervisor; without a handle it had ended when it was looked for.
    supervisor: (i32, Option<OwnedFd>),
    looked_ns: u64,
    lost_ns: Option<u64>,
}

impl Ownership {
    /// Makes this process one of a run. The kernel wakes it from a halt when its parent ends.
    ///
    /// # Errors
    /// [`IpcError::System`] if another process than the run's supervisor, or launcher, is its parent: an orphan must not touch
    /// the run.
    pub fn join(run: &RunFile, grace_ms: u32) -> Result<Self, IpcError> {
        let system = |cause| IpcError::System { action: "join the run", cause };
        set_parent_process_death_signal(Some(Signal::CONT)).map_err(|e| system(e.into()))?;
        let page = SupervisorPage::open(&run.root)?;
        let pid = page.pid.load(Ordering::Acquire);
        // A process whose supervisor has just been lost is a child of the launcher.
        if !parent().is_some_and(|parent| parent == pid || parent == run.launcher_pid) {
            return Err(system(std::io::Error::other("the supervisor has ended")));
        }
        let grace_ns = u64::from(grace_ms) * 1_000_000;
        Ok(Self { page, grace_ns, supervisor: (pid, open(pid)), looked_ns: 0, lost_ns: None })
    }

    /// Looks for the supervisor; a system call only if its heartbeat is late, and at most every 50 ms.
    #[must_use]
    pub fn look(&mut self, now_ns: u64) -> Orphanhood {
        if now_ns.saturating_sub(self.page.heartbeat_ns.load(Ordering::Acquire)) < FRESH_NS {
            self.lost_ns = None;
        } else if now_ns.saturating_sub(self.looked_ns) >= LOOK_INTERVAL_NS {
            self.looked_ns = now_ns;
            let pid = self.page.pid.load(Ordering::Acquire);
            if pid != self.supervisor.0 {
                // Another one has come since: its loss counts anew.
                (self.supervisor, self.lost_ns) = ((pid, open(pid)), None);
            }
            self.lost_ns = match &self.supervisor.1 {
                Some(handle) if !has_ended(handle) => None,
                _ => self.lost_ns.or(Some(now_ns)),
            };
        }
        let lost_for_ns = self.lost_ns.map_or(0, |lost| now_ns.saturating_sub(lost));
        match lost_for_ns.checked_sub(self.grace_ns) {
            None => Orphanhood::Owned,
            Some(0..GATES_END_NS) => Orphanhood::Brake,
            Some(GATES_END_NS..OTHERS_END_NS) => Orphanhood::GatesEnd,
            Some(_) => Orphanhood::AllEnd,
        }
    }
}

fn open(pid: i32) -> Option<OwnedFd> {
    pidfd_open(Pid::from_raw(pid)?, PidfdFlags::empty()).ok()
}

/// Whether the process of a handle has ended; a zombie has.
fn has_ended(handle: &OwnedFd) -> bool {
    let now = rustix::time::Timespec { tv_sec: 0, tv_nsec: 0 };
    poll(&mut [PollFd::new(handle, PollFlags::IN)], Some(&now)).is_ok_and(|ready| ready > 0)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn late_supervisor_owns_and_dead_one_does_after_no_grace() {
        let folder = tempfile::tempdir().unwrap();
        let page = SupervisorPage::open(folder.path().to_str().unwrap()).unwrap();
        let mut supervisor = std::process::Command::new("sleep").arg("1000").spawn().unwrap();
        let pid = supervisor.id() as i32;
        page.pid.store(pid, Ordering::Release);
        page.beat(1);
        let mut owner = Ownership {
            page: SupervisorPage::open(folder.path().to_str().unwrap()).unwrap(),
            grace_ns: 1_000_000_000,
            supervisor: (pid, open(pid)),
            looked_ns: 0,
            lost_ns: None,
        };
        let ms = |ms: u64| ms * 1_000_000;
        assert_eq!([10, 5000, 60_000].map(|at| owner.look(ms(at))), [Orphanhood::Owned; 3], "late, not lost");
        supervisor.kill().unwrap();
        // A zombie is lost; the time counts from the first look at it.
        while !has_ended(owner.supervisor.1.as_ref().unwrap()) {
            std::thread::yield_now();
        }
        let seen = [60_010, 60_060, 61_059, 61_060, 61_559, 61_560, 62_059, 62_060].map(|at| owner.look(ms(at)));
        use Orphanhood::{AllEnd, Brake, GatesEnd, Owned};
        assert_eq!(seen, [Owned, Owned, Owned, Brake, Brake, GatesEnd, GatesEnd, AllEnd]);
        supervisor.wait().unwrap();
        // A successor owns them before its first heartbeat.
        page.pid.store(std::process::id() as i32, Ordering::Release);
        assert_eq!(owner.look(ms(62_150)), Owned);
        page.beat(ms(62_170));
        assert_eq!([62_180, 70_000].map(|at| owner.look(ms(at))), [Owned; 2]);
        assert_eq!(owner.supervisor.0, std::process::id() as i32);
    }
}
