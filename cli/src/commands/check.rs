//! `hapfic check`: finds the errors of a scenario without running it.

use crate::{CommandOutcome, log_line, print};
use anyhow::Result;
use hapfic_config::Settings;
use hapfic_plant::Plant;
use hapfic_simulation::stability;
use hapfic_supervisor::children::find_program;
use hapfic_supervisor::children::started;

/// Checks a scenario; prints its contents, and the gains that would oscillate.
pub fn check(scenario: &str, set: &[String]) -> Result<CommandOutcome> {
    let settings = match Settings::load(scenario, set) {
        Ok(settings) => settings,
        Err(e) => return Ok(CommandOutcome::Rejected(e.into())),
    };
    let plant = match Plant::new(&settings) {
        Ok(plant) => plant,
        Err(e) => return Ok(CommandOutcome::Rejected(anyhow::Error::from(e).context(scenario.to_owned()))),
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
    for unstable in stability::unstable_sets(&settings)? {
        log_line(&unstable.warning());
    }
    Ok(CommandOutcome::Done)
}
