//! Tie of a process to its supervisor.

use rustix::process::{Signal, getppid, set_parent_process_death_signal};

/// Signal to a process when its supervisor ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Immediately, by SIGKILL, even if it is halted or in an endless loop: a process of this program.
    Killed,
    /// By SIGTERM: an external program, which may have a drive to brake.
    Terminated,
}

/// Ends this process when the thread that started it ends. The tie survives an `exec`.
///
/// # Errors
/// If the system rejects the call, or the supervisor has already ended: the kernel signals later deaths only.
pub fn tie_to_supervisor(pid: i32, ending: Ending) -> std::io::Result<()> {
    set_parent_process_death_signal(Some(match ending {
        Ending::Killed => Signal::KILL,
        Ending::Terminated => Signal::TERM,
    }))?;
    if supervisor_gone(pid) { Err(std::io::Error::other("the supervisor has ended")) } else { Ok(()) }
}

/// Whether the supervisor is no longer the parent of this process.
pub(crate) fn supervisor_gone(pid: i32) -> bool {
    getppid().is_none_or(|parent| parent.as_raw_nonzero().get() != pid)
}
