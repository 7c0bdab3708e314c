//! Reaping of ended processes, apart from the threads that watch them.
//!
//! When a process is reaped, the kernel removes its entries below `/proc`, and waits without a limit for those who use one of
//! them at the moment: on a loaded machine, where a monitor had to wait for a processor meanwhile, a parent was held up
//! for 2.7 s. So exit statuses are read without reaping, and a thread of ordinary priority reaps.

use anyhow::{Context, Result};
use rustix::io::Errno;
use rustix::process::{Pid, WaitId, WaitIdOptions, WaitOptions, wait, waitid};
use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;
use std::sync::OnceLock;
use std::sync::mpsc::{Receiver, Sender, channel};

/// What the thread reaps.
enum Ended {
    /// An ended child.
    Child(Pid),
    /// Ended children that others have started.
    Orphans,
}

static ENDED: OnceLock<Sender<Ended>> = OnceLock::new();

/// Starts the thread that reaps, with the priority of the caller.
///
/// # Errors
/// If the thread cannot be started.
pub fn start() -> Result<()> {
    let (sender, receiver) = channel();
    let reap = move || reap_all(&receiver);
    std::thread::Builder::new()
        .name("hapfic-reaper".to_owned())
        .spawn(reap)
        .context("cannot start the thread that reaps ended processes")?;
    // A second thread ends immediately.
    let _ = ENDED.set(sender);
    Ok(())
}

fn reap_all(receiver: &Receiver<Ended>) {
    for ended in receiver {
        match ended {
            Ended::Child(pid) => {
                // Fails only if the parent of this process has told the kernel to reap.
                let _ = waitid(WaitId::Pid(pid), WaitIdOptions::EXITED);
            }
            Ended::Orphans => while let Ok(Some(_)) = wait(WaitOptions::NOHANG) {},
        }
    }
}

/// Exit status of a child, once it has ended. It is reaped then, so its process id means nothing any more.
///
/// # Errors
/// If the process is no child, or its status was fetched before.
pub fn exit_status(pid: Pid) -> Result<Option<ExitStatus>, Errno> {
    let Some(status) = waitid(WaitId::Pid(pid), WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT)? else {
        return Ok(None);
    };
    pass_on(Ended::Child(pid));
    // As wait(2) encodes it.
    let raw = status.exit_status().map(|code| (code & 0xff) << 8).or(status.terminating_signal()).unwrap_or(0);
    Ok(Some(ExitStatus::from_raw(raw)))
}

/// Reaps the ended children that this process has got from lost ones.
pub fn reap_orphans() {
    pass_on(Ended::Orphans);
}

fn pass_on(ended: Ended) {
    if let Some(sender) = ENDED.get() {
        // Fails only if the thread has panicked: the kernel then reaps at the end of this process.
        let _ = sender.send(ended);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::process::Command;

    fn status_of(program: &str, argument: &str) -> (Pid, ExitStatus) {
        let mut command = Command::new(program);
        #[allow(clippy::zombie_processes)]
        let pid = Pid::from_child(&command.args(["-c", argument]).spawn().unwrap());
        loop {
            if let Some(status) = exit_status(pid).unwrap() {
                return (pid, status);
            }
            std::thread::yield_now();
        }
    }

    #[test]
    fn exit_status_code_or_signal_and_child_is_reaped() {
        start().unwrap();
        assert_eq!(status_of("sh", "exit 3").1.code(), Some(3));
        let (pid, status) = status_of("sh", "kill -9 $$");
        assert_eq!((status.code(), status.signal()), (None, Some(9)));
        while exit_status(pid).is_ok() {
            std::thread::yield_now();
        }
        assert_eq!(exit_status(pid), Err(Errno::CHILD));
    }
}
