//! The processes a supervisor starts, watches and ends.

use anyhow::{Context, Result};
use hapfic_config::{Processes, Settings};
use hapfic_ipc::RunFile;
use hapfic_ipc::message::Process;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child as Spawned, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// How long a process may take to end after being asked to.
const GRACE: Duration = Duration::from_millis(500);

/// A process of the stack.
#[derive(Debug)]
pub struct Child {
    /// Which one.
    pub process: Process,
    spawned: Spawned,
    handle: OwnedFd,
    ended: Option<ExitStatus>,
}

impl Child {
    /// Starts a process of the stack: this same program, or the scenario's foreign command.
    ///
    /// It is in a process group of its own, so that Ctrl-C reaches the supervisor alone, which then ends all in order.
    ///
    /// # Errors
    /// If the program cannot be started.
    pub fn start(process: Process, settings: &Settings, run_file: &Path) -> Result<Self> {
        let mut command = match foreign(&settings.processes, process) {
            Some(words) => {
                let mut command = Command::new(&words[0]);
                command.args(&words[1..]);
                command
            }
            None => {
                let mut command = Command::new(std::env::current_exe().context("cannot find this program's own file")?);
                command.arg("process").arg(process.name());
                command
            }
        };
        let spawned = command
            .env(RunFile::VARIABLE, run_file)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .process_group(0)
            .spawn()
            .with_context(|| format!("cannot start the {process} ({:?})", command.get_program()))?;
        let pid = Pid::from_child(&spawned);
        let handle = pidfd_open(pid, PidfdFlags::empty()).with_context(|| format!("cannot watch the {process}"))?;
        Ok(Self { process, spawned, handle, ended: None })
    }

    /// Its exit status, once it has ended.
    ///
    /// # Errors
    /// If the system does not tell.
    pub fn ended(&mut self) -> Result<Option<ExitStatus>> {
        if self.ended.is_none() {
            self.ended = self.spawned.try_wait().with_context(|| format!("cannot wait for the {}", self.process))?;
        }
        Ok(self.ended)
    }

    fn signal(&self, signal: Signal) {
        // A process that has ended already needs no signal.
        let _ = pidfd_send_signal(&self.handle, signal);
    }
}

fn foreign(processes: &Processes, process: Process) -> Option<&Vec<String>> {
    match process {
        Process::Plant => processes.plant.as_ref(),
        Process::Planner => processes.planner.as_ref(),
        Process::Controller | Process::Standby => processes.controller.as_ref(),
        Process::Supervisor => None,
    }
}

/// How a process ended, in words.
#[must_use]
pub fn describe(status: ExitStatus) -> String {
    use std::os::unix::process::ExitStatusExt;
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("ended with exit code {code}"),
        (None, Some(signal)) => match signal_hook::low_level::signal_name(signal) {
            Some(name) => format!("was ended by {name}"),
            None => format!("was ended by signal {signal}"),
        },
        _ => "ended".to_owned(),
    }
}

/// All processes of a run; ended when dropped.
#[derive(Debug, Default)]
pub struct Children(pub Vec<Child>);

impl Children {
    /// Waits until one of them ends, or the time is up.
    pub fn watch(&self, timeout: Duration) {
        let mut fds: Vec<_> =
            self.0.iter().filter(|c| c.ended.is_none()).map(|c| PollFd::new(&c.handle, PollFlags::IN)).collect();
        // Interrupted by a signal is as good as timed out: the caller looks at everything anyway.
        let _ = poll(&mut fds, Some(&hapfic_ipc::clock::timespec(timeout.as_nanos() as u64)));
    }

    /// Asks all to end and waits; kills what does not end in time. Returns those that had to be killed.
    ///
    /// # Errors
    /// If the system does not tell how one ended.
    pub fn end(&mut self) -> Result<Vec<Process>> {
        for child in &self.0 {
            // A stopped process acts on the signal only when it goes on.
            child.signal(Signal::TERM);
            child.signal(Signal::CONT);
        }
        let deadline = Instant::now() + GRACE;
        let mut killed = Vec::new();
        while self.living()? > 0 {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() && killed.is_empty() {
                for child in self.0.iter().filter(|c| c.ended.is_none()) {
                    killed.push(child.process);
                    child.signal(Signal::KILL);
                }
            }
            self.watch(left.max(Duration::from_millis(10)));
        }
        Ok(killed)
    }

    fn living(&mut self) -> Result<usize> {
        let mut living = 0;
        for child in &mut self.0 {
            living += usize::from(child.ended()?.is_none());
        }
        Ok(living)
    }
}

impl Drop for Children {
    fn drop(&mut self) {
        // Nothing to report to: whoever cared has called `end`.
        let _ = self.end();
    }
}
