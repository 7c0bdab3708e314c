//! How a process is tied to its supervisor.

use rustix::process::{Signal, getppid, set_parent_process_death_signal};

/// How a process ends when its supervisor does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// At once, whatever it is doing, be it halted or in an endless loop: a process of this program.
    Killed,
    /// By SIGTERM: a program that knows nothing of us, and may have a drive to brake.
    Asked,
}

/// Lets this process end when the thread that started it does. Outlives a change to another program.
///
/// # Errors
/// If the system refuses, or the supervisor has ended already: the signal is only sent for a death after it was asked for.
pub fn tie_to_supervisor(pid: i32, ending: Ending) -> std::io::Result<()> {
    set_parent_process_death_signal(Some(match ending {
        Ending::Killed => Signal::KILL,
        Ending::Asked => Signal::TERM,
    }))?;
    if supervisor_gone(pid) { Err(std::io::Error::other("the supervisor has ended")) } else { Ok(()) }
}

/// Whether the supervisor is not this process's parent any more.
pub(crate) fn supervisor_gone(pid: i32) -> bool {
    getppid().is_none_or(|parent| parent.as_raw_nonzero().get() != pid)
}
