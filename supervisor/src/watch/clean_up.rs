//! Clean-up after killed processes, in a helper process with a time limit.
//!
//! iceoryx2 waits without a limit for a segment that its maker has created and not yet given a size. If the maker is killed
//! in between, every thread that opens the segment hangs, when it runs as root: the clean-up of dead nodes, and the gate or
//! the recorder when they connect. So a thread of its own removes such segments, which lets their waiters continue, and
//! the clean-up runs in a process that can be killed. docs/decisions/0015-watching.md has the cause and a reproduction.

use crate::children::{describe, this_program};
use crate::reaper;
use anyhow::{Context, Result};
use hapfic_ipc::{RunFile, realtime};
use rustix::process::Pid;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::process::{Child as Spawned, Stdio};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

/// Folder of POSIX shared memory.
const SHM: &str = "/dev/shm";
/// Time a clean-up may take; it usually takes 10 ms.
const CLEAN_UP_TIMEOUT: Duration = Duration::from_secs(2);
/// Time after a failed clean-up before the next one.
const RETRY_INTERVAL: Duration = Duration::from_millis(500);
/// Time that killed helpers may take to end at the end of a run.
const END_TIMEOUT: Duration = Duration::from_millis(200);
/// Time after a loss in which unfinished segments are looked for, and interval of the looks.
const LOOK_TIME: Duration = Duration::from_secs(2);
const LOOK_INTERVAL: Duration = Duration::from_millis(2);
/// Interval of the looks without a loss.
const IDLE_INTERVAL: Duration = Duration::from_millis(500);
/// SIGKILL in the masks of pending signals in `/proc/PID/status`.
const SIGKILL_BIT: u64 = 1 << 8;

/// Helper process that removes dead nodes, and the request for it.
#[derive(Debug, Default)]
pub struct CleanUp {
    running: Option<(Spawned, Instant)>,
    /// Whether a clean-up is requested after the running one.
    requested: bool,
    /// Time before which no helper starts: the last one has failed.
    retry: Option<Instant>,
    /// Killed helpers that have not ended yet.
    killed: Vec<Spawned>,
}

/// Result of a look at the clean-up.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CleanUpState {
    /// No clean-up is running.
    Idle,
    /// A clean-up is running or requested.
    Running,
    /// A clean-up has ended, and no other is requested.
    Done,
    /// A clean-up has failed, and is repeated later.
    Failed(String),
}

impl CleanUp {
    /// Requests a clean-up, or another after the running one.
    pub fn request(&mut self) {
        self.requested = true;
    }

    /// Starts a requested clean-up, and returns what has become of the running one.
    pub fn poll(&mut self, run_file: &Path, priority: Option<u32>) -> CleanUpState {
        self.killed.retain(|helper| matches!(reaper::exit_status(Pid::from_child(helper)), Ok(None)));
        if let Some((mut helper, since)) = self.running.take() {
            let ended = match reaper::exit_status(Pid::from_child(&helper)) {
                Ok(None) if since.elapsed() < CLEAN_UP_TIMEOUT => {
                    self.running = Some((helper, since));
                    return CleanUpState::Running;
                }
                Ok(None) => {
                    let _ = helper.kill();
                    self.killed.push(helper);
                    Err("did not end in time and was killed".to_owned())
                }
                Ok(Some(status)) if status.success() => Ok(()),
                Ok(Some(status)) => Err(describe(status)),
                Err(e) => Err(format!("cannot be waited for: {e}")),
            };
            match ended {
                Ok(()) if !self.requested => return CleanUpState::Done,
                Ok(()) => {}
                Err(what) => return self.failed(&what),
            }
        }
        if !self.requested {
            return CleanUpState::Idle;
        }
        if self.retry.is_some_and(|retry| Instant::now() < retry) {
            return CleanUpState::Running;
        }
        match Self::start(run_file, priority) {
            Ok(helper) => {
                (self.running, self.requested, self.retry) = (Some((helper, Instant::now())), false, None);
                CleanUpState::Running
            }
            Err(e) => self.failed(&format!("cannot start: {e:#}")),
        }
    }

    fn failed(&mut self, what: &str) -> CleanUpState {
        (self.requested, self.retry) = (true, Some(Instant::now() + RETRY_INTERVAL));
        CleanUpState::Failed(format!("the clean-up of dead nodes {what}; it is repeated"))
    }

    fn start(run_file: &Path, priority: Option<u32>) -> Result<Spawned> {
        let mut command = this_program()?;
        command.args(["process", "clean-up"]).env(RunFile::VARIABLE, run_file).stdin(Stdio::null()).stdout(Stdio::null());
        let helper = command.spawn()?;
        if let Some(priority) = priority {
            // Fails only if the helper has already ended.
            let _ = realtime::set_priority_of(Pid::from_child(&helper), priority);
        }
        Ok(helper)
    }
}

impl Drop for CleanUp {
    fn drop(&mut self) {
        if let Some((helper, _)) = &mut self.running {
            let _ = helper.kill();
        }
        self.killed.extend(self.running.take().map(|(helper, _)| helper));
        let begun = Instant::now();
        while !self.killed.is_empty() && begun.elapsed() < END_TIMEOUT {
            self.killed.retain(|helper| matches!(reaper::exit_status(Pid::from_child(helper)), Ok(None)));
            std::thread::sleep(LOOK_INTERVAL);
        }
    }
}

/// Thread that removes unfinished segments of killed processes.
#[derive(Debug)]
pub struct SegmentRemover(Option<Sender<()>>);

impl SegmentRemover {
    /// Starts the thread for the superuser, whom alone such segments block; it ends when this is dropped. `prefix` begins the names of the run's segments.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub fn start(prefix: String) -> Result<Self> {
        // For other users a segment without a size is not readable, and its waiters have a time limit.
        if !rustix::process::geteuid().is_root() {
            return Ok(Self(None));
        }
        let (sender, receiver) = channel();
        let look = move || {
            let mut until = Instant::now();
            loop {
                let interval = if Instant::now() < until { LOOK_INTERVAL } else { IDLE_INTERVAL };
                match receiver.recv_timeout(interval) {
                    Ok(()) => until = Instant::now() + LOOK_TIME,
                    Err(RecvTimeoutError::Timeout) => remove_unfinished_segments(&prefix),
                    Err(RecvTimeoutError::Disconnected) => return,
                }
            }
        };
        std::thread::Builder::new()
            .name("hapfic-segments".to_owned())
            .spawn(look)
            .context("cannot start the thread that removes unfinished segments")?;
        Ok(Self(Some(sender)))
    }

    /// Looks more often for a while: a process was lost.
    pub fn process_lost(&self) {
        if let Some(sender) = &self.0 {
            // Fails only if the thread has panicked.
            let _ = sender.send(());
        }
    }
}

/// Removes the segments without a size whose makers are dead.
fn remove_unfinished_segments(prefix: &str) {
    for entry in fs::read_dir(SHM).into_iter().flatten().flatten() {
        let path = entry.path();
        // The maker holds the segment open from its creation until it has a size.
        if entry.file_name().to_string_lossy().starts_with(prefix) && is_empty(&path) && !is_held(&path) && is_empty(&path) {
            // A waiter then finds no segment, and reports a failed connection.
            let _ = fs::remove_file(&path);
        }
    }
}

fn is_empty(segment: &Path) -> bool {
    fs::symlink_metadata(segment).is_ok_and(|metadata| metadata.is_file() && metadata.size() == 0)
}

/// Whether a process that will run on holds a file open.
fn is_held(file: &Path) -> bool {
    fs::read_dir("/proc").into_iter().flatten().flatten().any(|process| {
        let fds = fs::read_dir(process.path().join("fd")).into_iter().flatten().flatten();
        let holds = fds.map(|fd| fs::read_link(fd.path())).any(|target| target.is_ok_and(|target| target == file));
        holds && !is_dying(&process.path())
    })
}

/// Whether SIGKILL is pending for a process, which then never runs again.
fn is_dying(process: &Path) -> bool {
    let status = fs::read_to_string(process.join("status")).unwrap_or_default();
    let masks = status.lines().filter_map(|line| line.strip_prefix("SigPnd:").or_else(|| line.strip_prefix("ShdPnd:")));
    masks.filter_map(|mask| u64::from_str_radix(mask.trim(), 16).ok()).any(|mask| mask & SIGKILL_BIT != 0)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn unfinished_segment_of_dead_maker_is_removed() {
        let prefix = format!("htseg{}_", std::process::id());
        let path = |name: &str| Path::new(SHM).join(format!("{prefix}{name}"));
        let held = fs::File::create(path("held")).unwrap();
        fs::write(path("finished"), "x").unwrap();
        drop(fs::File::create(path("dead")).unwrap());
        remove_unfinished_segments(&prefix);
        assert_eq!(["held", "finished", "dead"].map(|name| path(name).exists()), [true, true, false]);
        drop(held);
        remove_unfinished_segments(&prefix);
        assert_eq!(["held", "finished"].map(|name| path(name).exists()), [false, true]);
        fs::remove_file(path("finished")).unwrap();
    }
}
