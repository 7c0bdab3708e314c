//! What a process must do before it becomes another program.

use std::os::unix::process::CommandExt;
use std::process::Command;

/// Lets a program, once started, get SIGTERM when the thread that started it ends: also a foreign one that knows nothing of us.
/// And puts it into a process group of its own, so that Ctrl-C reaches the supervisor alone.
pub fn tie_to_parent(command: &mut Command) {
    let parent = rustix::process::getpid();
    command.process_group(0);
    // SAFETY: between fork and exec only async-signal-safe system calls are made, and nothing is allocated.
    unsafe {
        command.pre_exec(move || {
            rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::TERM))?;
            // Too late for the signal if the parent has gone in between.
            if rustix::process::getppid() == Some(parent) { Ok(()) } else { Err(rustix::io::Errno::CHILD.into()) }
        });
    }
}
