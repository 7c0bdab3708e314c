//! The processes that a supervisor starts, watches and ends.

use crate::notify::Notify;
use crate::reaper;
use anyhow::{Context, Result};
use hapfic_config::{ExternalProcesses, Settings};
use hapfic_ipc::{ProcessStart, RunFile};
use hapfic_messages::Process;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Pid, PidfdFlags, Signal, kill_process_group, pidfd_open};
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Time a process may take to end after SIGTERM.
const END_TIMEOUT: Duration = Duration::from_secs(2);
/// Time a process may take to end after SIGKILL. One that is frozen, or inside an uninterruptible system call, never ends.
const KILL_TIMEOUT: Duration = Duration::from_millis(200);

/// A process of the stack.
#[derive(Debug)]
pub struct Child {
    /// Role of the process.
    pub process: Process,
    pid: Pid,
    /// A lost supervisor has started it, and the launcher gets its exit status.
    adopted: bool,
    handle: OwnedFd,
    ended: Option<End>,
}

/// End of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Its exit status.
    Status(ExitStatus),
    /// Another process got the exit status.
    Unknown,
}

impl Child {
    /// Starts this same program as a process of the stack; it executes the scenario's external command, if any. `input` is
    /// its standard input.
    ///
    /// Nothing runs between fork and exec, so the kernel shares this process's memory instead of copying its page
    /// tables. The gate, whose pages are locked, therefore has no page faults afterwards.
    ///
    /// # Errors
    /// If the program cannot be started.
    pub fn start(process: Process, settings: &Settings, run_file: &Path, start: ProcessStart, input: Stdio) -> Result<Self> {
        let mut command = this_program()?;
        command.arg("process").arg(process.name());
        if let Some(external) = external_command(&settings.processes, process) {
            command.arg("--").args(external);
        }
        mark(&mut command, process, run_file, start);
        let mut spawned = command
            .process_group(0)
            .stdin(input)
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
        Ok(Self { process, pid, adopted: false, handle, ended: None })
    }

    /// Takes over a process that a lost supervisor has started.
    #[must_use]
    pub fn adopted(process: Process, pid: Pid, handle: OwnedFd) -> Self {
        Self { process, pid, adopted: true, handle, ended: None }
    }

    /// Returns the process id.
    #[must_use]
    pub fn pid(&self) -> Pid {
        self.pid
    }

    /// Returns how the process has ended, once it has.
    ///
    /// # Errors
    /// If the system does not report it.
    pub fn ended(&mut self) -> Result<Option<End>> {
        if self.ended.is_none() {
            self.ended = if self.adopted {
                has_ended(&self.handle).then_some(End::Unknown)
            } else {
                let status = reaper::exit_status(self.pid).with_context(|| format!("cannot wait for the {}", self.process))?;
                status.map(End::Status)
            };
        }
        Ok(self.ended)
    }

    /// Describes a process that does not end: its id and its state in `/proc`.
    #[must_use]
    pub fn remains(&self) -> String {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.pid())).unwrap_or_default();
        let state = status.lines().find_map(|line| line.strip_prefix("State:")).map_or("unknown", str::trim);
        format!("process {}, state {state}", self.pid())
    }

    /// Sends a signal to the whole process group: an external process may have started others.
    pub fn signal(&self, signal: Signal) {
        // Fails only if the group has ended.
        let _ = kill_process_group(self.pid, signal);
    }
}

/// Whether the process of a handle has ended.
pub(crate) fn has_ended(handle: &OwnedFd) -> bool {
    let now = hapfic_ipc::clock::timespec(0);
    poll(&mut [PollFd::new(handle, PollFlags::IN)], Some(&now)).is_ok_and(|ready| ready > 0)
}

/// Puts run, process and start into the environment of a command.
pub(crate) fn mark(command: &mut Command, process: Process, run_file: &Path, start: ProcessStart) {
    command
        .env(RunFile::VARIABLE, run_file)
        .env(RunFile::PROCESS, process.name())
        .env(RunFile::GENERATION, start.generation.to_string());
}

/// Returns a command that starts this same program, even if another version has replaced its file since.
///
/// # Errors
/// If the system does not report the program's path.
pub fn this_program() -> Result<Command> {
    let name = std::env::current_exe().context("cannot find this program's own file")?;
    let mut command = Command::new("/proc/self/exe");
    command.arg0(name);
    for variable in Notify::VARIABLES {
        command.env_remove(variable);
    }
    Ok(command)
}

/// Returns the processes of a run, in the order of their start.
#[must_use]
pub fn started(settings: &Settings) -> &'static [Process] {
    const ALL: [Process; 6] =
        [Process::Gate, Process::SpareGate, Process::Plant, Process::Planner, Process::Controller, Process::Standby];
    if settings.supervisor.standby { &ALL } else { &ALL[..5] }
}

/// Returns the scenario's external command for a process, if any.
#[must_use]
pub fn external_command(processes: &ExternalProcesses, process: Process) -> Option<&Vec<String>> {
    match process {
        Process::Plant => processes.plant.as_ref(),
        Process::Planner => processes.planner.as_ref(),
        Process::Controller | Process::Standby => processes.controller.as_ref(),
        Process::Supervisor | Process::Recorder | Process::Gate | Process::SpareGate => None,
    }
}

/// Checks that the program of an external process exists and is executable.
///
/// # Errors
/// If it does not; the error names the setting.
pub fn find_program(processes: &ExternalProcesses, process: Process) -> Result<()> {
    let Some(program) = external_command(processes, process).map(|command| Path::new(&command[0])) else { return Ok(()) };
    // The search of execvp(3): a name with a slash is a path, any other name lies in a folder of PATH.
    let found = if program.components().count() > 1 {
        is_executable(program)
    } else {
        std::env::var_os("PATH").is_some_and(|path| std::env::split_paths(&path).any(|dir| is_executable(&dir.join(program))))
    };
    anyhow::ensure!(
        found,
        "processes.{process}: found no executable program '{}', expected a path, or a name in PATH",
        program.display()
    );
    Ok(())
}

fn is_executable(program: &Path) -> bool {
    program.is_file() && rustix::fs::access(program, rustix::fs::Access::EXEC_OK).is_ok()
}

impl std::fmt::Display for End {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Status(status) => f.write_str(&describe(*status)),
            Self::Unknown => f.write_str("ended"),
        }
    }
}

/// Describes how a process ended.
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

/// Waits until any process ends, or for `timeout`.
pub fn watch<'a>(children: impl Iterator<Item = &'a Child>, timeout: Duration) {
    let mut fds: Vec<_> = children.filter(|c| c.ended.is_none()).map(|c| PollFd::new(&c.handle, PollFlags::IN)).collect();
    // An interrupted wait equals a time-out: the caller checks everything anyway.
    let _ = poll(&mut fds, Some(&hapfic_ipc::clock::timespec(timeout.as_nanos() as u64)));
}

/// Sends SIGTERM to all processes, and SIGKILL to those that do not end in time; takes at most 2.2 s.
///
/// # Errors
/// If the system does not report how a process ended.
pub fn end(mut children: Vec<Child>) -> Result<Killed> {
    for child in &children {
        // A stopped process handles SIGTERM only after SIGCONT.
        child.signal(Signal::TERM);
        child.signal(Signal::CONT);
    }
    wait_until_ended(&mut children, END_TIMEOUT)?;
    let running = |children: &[Child]| children.iter().filter(|c| c.ended.is_none()).map(|c| c.process).collect();
    let processes: Vec<Process> = running(&children);
    for child in &children {
        // Also the processes that the leader has left in its group.
        child.signal(Signal::KILL);
    }
    wait_until_ended(&mut children, KILL_TIMEOUT)?;
    children.retain(|child| child.ended.is_none());
    Ok(Killed { processes, abandoned: children })
}

/// Kills a process and all others of its group; takes at most 200 ms. Returns the process if it has not ended by then.
///
/// # Errors
/// If the system does not report how it ended.
pub fn kill(child: Child) -> Result<Option<Child>> {
    child.signal(Signal::KILL);
    let mut children = [child];
    wait_until_ended(&mut children, KILL_TIMEOUT)?;
    let [child] = children;
    Ok(child.ended.is_none().then_some(child))
}

/// Processes that did not end on request.
#[derive(Debug, Default)]
pub struct Killed {
    /// All of them.
    pub processes: Vec<Process>,
    /// Those that SIGKILL has not ended either.
    pub abandoned: Vec<Child>,
}

fn wait_until_ended(children: &mut [Child], timeout: Duration) -> Result<()> {
    let deadline = Instant::now() + timeout;
    loop {
        let mut running = false;
        for child in &mut *children {
            running |= child.ended()?.is_none();
        }
        let left = deadline.saturating_duration_since(Instant::now());
        if !running || left.is_zero() {
            return Ok(());
        }
        watch(children.iter(), left);
    }
}
