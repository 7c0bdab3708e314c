//! How a process is tied to its supervisor.

use rustix::process::{Signal, getppid, set_parent_process_death_signal};

/// Lets this process get SIGTERM when the thread that started it ends. Outlives a change to another program: also one that knows
/// nothing of us ends with its supervisor.
///
/// # Errors
/// If the system refuses, or the supervisor has ended already: the signal is only sent for a death after it was asked for.
pub fn tie_to_supervisor(pid: i32) -> std::io::Result<()> {
    set_parent_process_death_signal(Some(Signal::TERM))?;
    if supervisor_gone(pid) { Err(std::io::Error::other("the supervisor has ended")) } else { Ok(()) }
}

/// Whether the supervisor is not this process's parent any more.
pub(crate) fn supervisor_gone(pid: i32) -> bool {
    getppid().is_none_or(|parent| parent.as_raw_nonzero().get() != pid)
}
