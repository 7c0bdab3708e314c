//! `hapfic process NAME`: one process of a running stack.

use crate::CommandOutcome;
use anyhow::{Context as _, Result};
use clap::ValueEnum;
use hapfic_config::Settings;
use hapfic_ipc::realtime::{SchedRequest, apply_to_current_thread};
use hapfic_ipc::{Bus, Context, Domain, Orphanhood, Ownership, ProcessStart, RunFile, SupervisorPage};
use hapfic_messages::{Clock, Process, RealtimeMode};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// Role of a process that launcher or supervisor starts.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum ProcessName {
    /// The simulated robot.
    Plant,
    /// The harmonic planner.
    Planner,
    /// The primary controller.
    Controller,
    /// The standby controller.
    Standby,
    /// The gate.
    Gate,
    /// The spare gate.
    #[value(name = "spare_gate")]
    SpareGate,
    /// The recorder.
    Recorder,
    /// The supervisor, which the launcher starts.
    Supervisor,
    /// Helper that removes dead nodes and ends.
    CleanUp,
}

/// Joins the run that the environment names and works until it ends, or becomes an external process that does.
pub fn process(name: ProcessName, external: &[String]) -> Result<CommandOutcome> {
    let process = match name {
        ProcessName::CleanUp => return clean_up(),
        ProcessName::Plant => Process::Plant,
        ProcessName::Planner => Process::Planner,
        ProcessName::Controller => Process::Controller,
        ProcessName::Standby => Process::Standby,
        ProcessName::Recorder => Process::Recorder,
        ProcessName::Supervisor => Process::Supervisor,
        ProcessName::Gate => Process::Gate,
        ProcessName::SpareGate => Process::SpareGate,
    };
    let (path, run) = match run_file() {
        Ok(run) => run,
        Err(e) => return Ok(CommandOutcome::Rejected(e)),
    };
    let settings = Settings::from_effective(&run.settings, &run.urdf_name, &run.urdf)?;
    if let [program, arguments @ ..] = external {
        // It goes on without a supervisor, as the others do; its successor, or the last gate, ends it.
        let _ = Ownership::join(&run, settings.supervisor.grace_ms)?;
        if run.clock == Clock::Realtime && run.realtime != RealtimeMode::Off {
            take_scheduling(&run, &settings, process);
        }
        let failed = std::process::Command::new(program).args(arguments).exec();
        return Err(failed).with_context(|| format!("processes.{process}: cannot start '{program}'"));
    }
    let start = ProcessStart::from_env()?;
    match process {
        Process::Recorder => hapfic_supervisor::recorder::process::run(&run, &settings, start).context("recorder")?,
        Process::Gate | Process::SpareGate => {
            let orphanhood = hapfic_gate_process::run(&run, &settings, process, start).context("gate")?;
            if orphanhood > Orphanhood::Owned {
                hapfic_supervisor::registry::end_orphans(Path::new(&run.root));
            }
        }
        Process::Supervisor => {
            let completed = hapfic_supervisor::supervise::run(&run, &path, settings, start)?;
            return Ok(if completed { CommandOutcome::Done } else { CommandOutcome::Failed });
        }
        _ => run_tick_by_tick(&run, &settings, process, start)?,
    }
    Ok(CommandOutcome::Done)
}

/// Takes priority and core of a role, which the program that is executed next keeps. What is not granted shows in the
/// heartbeats of that program, if anywhere.
fn take_scheduling(run: &RunFile, settings: &Settings, process: Process) {
    let realtime = &settings.realtime;
    let (priority, core) = match process {
        Process::Plant => (realtime.priority_plant, realtime.core_plant),
        Process::Planner => (realtime.priority_planner, realtime.core_planner),
        Process::Standby => (realtime.priority_controller - 1, realtime.core_standby.or(run.standby_core)),
        _ => (realtime.priority_controller, realtime.core_controller),
    };
    let _ = apply_to_current_thread(SchedRequest::new(priority, core.or(run.core)));
}

/// Runs a process that answers each state.
fn run_tick_by_tick(run: &RunFile, settings: &Settings, process: Process, start: ProcessStart) -> Result<()> {
    let mut context = Context::join(run, settings.supervisor.grace_ms, process, start)?;
    match process {
        Process::Plant => hapfic_plant_process::run(&mut context, settings).context("plant")?,
        Process::Planner => hapfic_planner_process::run(&mut context, settings).context("planner")?,
        _ => hapfic_controller_process::run(&mut context, settings).context("controller")?,
    }
    Ok(())
}

/// Reads the run file that the environment names.
fn run_file() -> Result<(PathBuf, RunFile)> {
    let path = std::env::var_os(RunFile::VARIABLE).map(PathBuf::from).with_context(|| {
        format!("{} is not set, expected the path of a run file. Hint: `hapfic run` starts the processes", RunFile::VARIABLE)
    })?;
    let run = RunFile::read(&path)?;
    Ok((path, run))
}

/// Removes the dead nodes of the run that the environment names.
fn clean_up() -> Result<CommandOutcome> {
    let (_, run) = match run_file() {
        Ok(run) => run,
        Err(e) => return Ok(CommandOutcome::Rejected(e)),
    };
    let supervisor = SupervisorPage::open(&run.root)?.pid.load(Ordering::Acquire);
    hapfic_ipc::tie_to_parent(supervisor).context("cannot join the run")?;
    hapfic_ipc::service::silence_transport_log();
    let domain = Domain::new(&run.prefix, &run.root)?;
    Bus::open(&domain, "clean-up")?.clean_up_dead_nodes();
    Ok(CommandOutcome::Done)
}
