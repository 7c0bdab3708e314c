//! The processes a supervisor starts, watches and ends.

use crate::notify::Notify;
use anyhow::{Context, Result};
use hapfic_config::{Processes, Settings};
use hapfic_ipc::{ProcessStart, RunFile};
use hapfic_messages::Process;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Pid, PidfdFlags, Signal, kill_process_group, pidfd_open};
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child as Spawned, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// How long a process may take to end after being asked to.
const GRACE: Duration = Duration::from_secs(2);

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
    /// Starts a process of the stack: this same program, which becomes the scenario's foreign command if there is one.
    ///
    /// Nothing is asked to be done between fork and exec: so the system shares this process's memory with the new one instead of
    /// copying its tables, and the gate, whose pages are locked, does not fault on each of them afterwards.
    ///
    /// # Errors
    /// If the program cannot be started.
    pub fn start(process: Process, settings: &Settings, run_file: &Path, start: ProcessStart) -> Result<Self> {
        let mut command = this_program()?;
        command.arg("process").arg(process.name());
        if let Some(words) = foreign(&settings.processes, process) {
            command.arg("--").args(words);
        }
        command.env(RunFile::VARIABLE, run_file).env(RunFile::GENERATION, start.generation.to_string());
        command.env_remove(RunFile::RESUME);
        if let Some(tick) = start.resume {
            command.env(RunFile::RESUME, tick.to_string());
        }
        let mut spawned = command
            .process_group(0)
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

    /// Its process id.
    #[must_use]
    pub fn pid(&self) -> Pid {
        Pid::from_child(&self.spawned)
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
    pub fn signal(&self, signal: Signal) {
        // A group that has ended already needs no signal.
        let _ = kill_process_group(Pid::from_child(&self.spawned), signal);
    }
}

/// This very program, to be started once more: also when its file has been replaced by another version since.
///
/// # Errors
/// If the system does not tell its name.
pub fn this_program() -> Result<Command> {
    let name = std::env::current_exe().context("cannot find this program's own file")?;
    let mut command = Command::new("/proc/self/exe");
    command.arg0(name);
    for variable in Notify::VARIABLES {
        command.env_remove(variable);
    }
    Ok(command)
}

/// The processes of a run, in the order in which they are started.
#[must_use]
pub fn started(settings: &Settings) -> &'static [Process] {
    const ALL: [Process; 4] = [Process::Plant, Process::Planner, Process::Controller, Process::Standby];
    if settings.supervisor.standby { &ALL } else { &ALL[..3] }
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
        may_run(program)
    } else {
        std::env::var_os("PATH").is_some_and(|path| std::env::split_paths(&path).any(|dir| may_run(&dir.join(program))))
    };
    anyhow::ensure!(
        found,
        "processes.{process}: found no program '{}' that may be run, expected the path of one, or a name in PATH",
        program.display()
    );
    Ok(())
}

fn may_run(program: &Path) -> bool {
    program.is_file() && rustix::fs::access(program, rustix::fs::Access::EXEC_OK).is_ok()
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

/// Waits until one of some processes ends, or the time is up.
pub fn watch<'a>(children: impl Iterator<Item = &'a Child>, timeout: Duration) {
    let mut fds: Vec<_> = children.filter(|c| c.ended.is_none()).map(|c| PollFd::new(&c.handle, PollFlags::IN)).collect();
    // Interrupted by a signal is as good as times out: the caller looks at everything anyway.
    let _ = poll(&mut fds, Some(&hapfic_ipc::clock::timespec(timeout.as_nanos() as u64)));
}

/// Asks all to end and waits; kills what does not end in time. Returns those that had to be killed.
///
/// # Errors
/// If the system does not tell how one ended.
pub fn end(mut children: Vec<Child>) -> Result<Vec<Process>> {
    for child in &children {
        // A stopped process acts on the signal only when it goes on.
        child.signal(Signal::TERM);
        child.signal(Signal::CONT);
    }
    let deadline = Instant::now() + GRACE;
    let mut killed = Vec::new();
    loop {
        let mut living = 0;
        for child in &mut children {
            living += usize::from(child.ended()?.is_none());
        }
        if living == 0 {
            break;
        }
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() && killed.is_empty() {
            for child in children.iter().filter(|c| c.ended.is_none()) {
                killed.push(child.process);
                child.signal(Signal::KILL);
            }
        }
        watch(children.iter(), left.max(Duration::from_millis(10)));
    }
    for child in &children {
        // Whatever its leader has left in the group.
        child.signal(Signal::KILL);
    }
    Ok(killed)
}
