//! `hapfic doctor`: whether this machine is good enough for 1 kHz.

use crate::{CommandOutcome, log_line, print};
use anyhow::{Context, Result};
use hapfic_config::Settings;
use hapfic_diagnostics::doctor::{Examination, Grade, ProcessInfo, SysfsRoot, checks, evaluate, measure};
use hapfic_supervisor::registry;

/// Scenario whose priorities are examined: the default of `hapfic run`.
const SCENARIO: &str = "floor";

/// Examines the machine, measures for some seconds, and prints the verdict.
pub fn doctor(seconds: u32, json: bool) -> Result<CommandOutcome> {
    let settings = Settings::load(SCENARIO, &[]).context("cannot read the embedded scenario")?;
    let priority = settings.realtime.priority_plant;
    // Runs in progress have their cores; the measurement takes those of the next run.
    let others = match registry::running() {
        Ok(runs) => runs.len(),
        Err(e) => {
            log_line(&format!("hapfic: cannot read which runs are in progress: {e:#}"));
            0
        }
    };
    if others > 0 {
        log_line(&format!(
            "hapfic: found runs in progress ({others}), expected none: they and the measurement disturb each other"
        ));
    }
    let process_info = ProcessInfo::ask(priority, others);
    // The checks come before the measurement, which loads the machine.
    let checks = checks(&SysfsRoot::default(), &process_info);
    log_line(&format!("hapfic: measuring for {seconds} s"));
    let other = process_info.cores.iter().rev().copied().find(|core| Some(*core) != process_info.core);
    let measured = measure(seconds, priority, process_info.core, other)?;
    let verdict = evaluate(&checks, &measured);
    let good_enough = verdict.grade != Grade::NotGood;
    let examination = Examination { verdict, measured, checks };
    if json {
        print(&serde_json::to_string_pretty(&examination)?);
    } else {
        print(examination.text().trim_end());
    }
    Ok(if good_enough { CommandOutcome::Done } else { CommandOutcome::NotGoodEnough })
}
