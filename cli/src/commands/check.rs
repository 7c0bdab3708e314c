//! `hapfic check`: finds the errors of a scenario without running it.

use crate::{CommandOutcome, log_line, print};
use anyhow::Result;
use hapfic_config::Settings;
use hapfic_plant::Plant;
use hapfic_simulation::findings;
use hapfic_supervisor::children::find_program;
use hapfic_supervisor::children::started;

/// Joints above which gravity compensation is the default.
const ARM_JOINTS: usize = 3;

/// Checks a scenario; prints its contents, and all values that are valid but unwise.
pub fn check(scenario: &str, set: &[String]) -> Result<CommandOutcome> {
    let settings = match Settings::load(scenario, set) {
        Ok(settings) => settings,
        Err(e) => return Ok(CommandOutcome::Rejected(e.into())),
    };
    let plant = match Plant::new(&settings) {
        Ok(plant) => plant,
        Err(e) => {
            let hint =
                findings::degrees_hint(&settings.robot.start_position).map_or_else(String::new, |h| format!(". Hint: {h}"));
            return Ok(CommandOutcome::Rejected(anyhow::anyhow!("{scenario}: {e}{hint}")));
        }
    };
    for process in started(&settings).iter().copied() {
        if let Err(e) = find_program(&settings.processes, process) {
            return Ok(CommandOutcome::Rejected(e.context(scenario.to_owned())));
        }
    }
    let joints: Vec<_> = plant.chain().joints().iter().map(|j| j.name.as_str()).collect();
    let state = plant.sample();
    let [x, y, z] = state.foot_position;
    print(&format!(
        "{scenario}: valid. {} s, {} operator changes, robot {} with joints {}, foot starts at ({x:.4}, {y:.4}, {z:.4}) m",
        settings.duration_ticks as f64 * hapfic_config::PERIOD_S,
        settings.operator.len(),
        settings.robot.urdf.name,
        joints.join(" "),
    ));
    if settings.initial.gravity_compensation && plant.chain().dof() > ARM_JOINTS {
        print(&format!(
            "gravity is compensated: with {} joints the weight would turn those that no axis of the task holds",
            plant.chain().dof()
        ));
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    for finding in findings::all(&settings, cores)? {
        log_line(&finding.to_string());
    }
    Ok(CommandOutcome::Done)
}
