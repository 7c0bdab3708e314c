//! `hapfic process NAME`: one process of a running stack.

use crate::Outcome;
use crate::cli::ProcessName;
use anyhow::{Context as _, Result};
use hapfic_config::Settings;
use hapfic_ipc::message::Process;
use hapfic_ipc::{Context, RunFile};
use std::path::PathBuf;

/// Joins the run that the environment names, and works until it ends.
pub fn process(name: ProcessName) -> Result<Outcome> {
    let process = match name {
        ProcessName::Plant => Process::Plant,
        ProcessName::Planner => Process::Planner,
        ProcessName::Controller => Process::Controller,
        ProcessName::Standby => Process::Standby,
    };
    let Some(path) = std::env::var_os(RunFile::VARIABLE).map(PathBuf::from) else {
        return Ok(Outcome::Refused(anyhow::anyhow!(
            "{} is not set, expected the path of a run file: processes are started by `hapfic run`",
            RunFile::VARIABLE
        )));
    };
    let run = match RunFile::read(&path) {
        Ok(run) => run,
        Err(e) => return Ok(Outcome::Refused(e.into())),
    };
    let settings = Settings::from_effective(&run.settings, &run.urdf_name, &run.urdf)?;
    let mut context = Context::join(&run, process)?;
    match process {
        Process::Plant => hapfic_plant::process::run(&mut context, &settings).context("plant")?,
        Process::Planner => hapfic_planner::process::run(&mut context, &settings).context("planner")?,
        _ => hapfic_controller::process::run(&mut context, &settings).context("controller")?,
    }
    Ok(Outcome::Done)
}
