//! The processes a supervisor starts, watches and ends.

use anyhow::{Context, Result};
use hapfic_config::{Processes, Settings};
use hapfic_ipc::RunFile;
use hapfic_ipc::message::Process;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Pid, PidfdFlags, Signal, kill_process_group, pidfd_open};
use std::os::fd::OwnedFd;
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
        hapfic_ipc::tie_to_parent(&mut command);
        let mut spawned = command
            .env(RunFile::VARIABLE, run_file)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .with_context(|| format!("cannot start the {process} ({:?})", command.get_program()))?;
        let pid = Pid::from_child(&spawned);
        let handle = match pidfd_open(pid, PidfdFlags::empty()) {
            Ok(handle) => handle,
            Err(e) => {
                let _ = spawned.kill().and_then(|()| spawned.wait());
                return Err(e).with_context(|| format!("cannot watch the {process}"));
            }
        };
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

    /// To all of its process group: a foreign command may have started processes of its own.
    fn signal(&self, signal: Signal) {
        // A group that has ended already needs no signal.
        let _ = kill_process_group(Pid::from_child(&self.spawned), signal);
    }
}

/// The scenario's own command for a process, if it has one.
#[must_use]
pub fn foreign(processes: &Processes, process: Process) -> Option<&Vec<String>> {
    match process {
        Process::Plant => processes.plant.as_ref(),
        Process::Planner => processes.planner.as_ref(),
        Process::Controller | Process::Standby => processes.controller.as_ref(),
        Process::Supervisor => None,
    }
}

/// Checks that a foreign command's program is there.
///
/// # Errors
/// If it is not, naming the setting.
pub fn find_program(processes: &Processes, process: Process) -> Result<()> {
    let Some(program) = foreign(processes, process).map(|words| Path::new(&words[0])) else { return Ok(()) };
    // As the system looks for it: with a slash it is a path, without one it is in a folder of PATH.
    let found = if program.components().count() > 1 {
        program.is_file()
    } else {
        std::env::var_os("PATH").is_some_and(|path| std::env::split_paths(&path).any(|dir| dir.join(program).is_file()))
    };
    anyhow::ensure!(
        found,
        "processes.{process}: found no program '{}', expected the path of one, or a name in PATH",
        program.display()
    );
    Ok(())
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
        for child in &self.0 {
            // Whatever its leader has left in the group.
            child.signal(Signal::KILL);
        }
        self.0.clear();
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
