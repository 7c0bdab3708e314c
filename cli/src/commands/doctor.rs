//! `hapfic doctor`: whether this machine is good enough for 1 kHz.

use crate::{Outcome, print, say};
use anyhow::{Context, Result};
use hapfic_config::Settings;
use hapfic_diagnostics::doctor::{Examination, Grade, ProcessInfo, SysfsRoot, checks, evaluate, measure};
use hapfic_supervisor::registry;

/// The scenario whose priorities are asked for: what `hapfic run` runs if nothing is said.
const SCENARIO: &str = "floor";

/// Looks at the machine, measures for some seconds, and says what comes of it.
pub fn doctor(seconds: u32, json: bool) -> Result<Outcome> {
    let settings = Settings::load(SCENARIO, &[]).context("cannot read the embedded scenario")?;
    let priority = settings.realtime.priority_plant;
    // Runs that are going on have their cores; this takes the next one's, as another run would.
    let others = match registry::running() {
        Ok(runs) => runs.len(),
        Err(e) => {
            say(&format!("hapfic: cannot see which runs are going on: {e:#}"));
            0
        }
    };
    if others > 0 {
        say(&format!("hapfic: found runs going on ({others}), expected none: they and the measurement disturb each other"));
    }
    let process_info = ProcessInfo::ask(priority, others);
    // Before the measurement, which is a load itself.
    let checks = checks(&SysfsRoot::default(), &process_info);
    say(&format!("hapfic: measuring for {seconds} s"));
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
    Ok(if good_enough { Outcome::Done } else { Outcome::NotGoodEnough })
}
