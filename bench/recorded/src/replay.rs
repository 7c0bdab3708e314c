//! Parts of a scenario to replay on the plant alone.

use crate::RecordError;
use hapfic_config::Settings;
use hapfic_messages::Command;
use hapfic_plant::{Plant, PlantError};
use hapfic_simulation::Simulation;

/// A plant at a tick, and its commands from this tick on.
#[derive(Clone, Debug)]
pub struct Replay {
    /// Plant before the first tick.
    pub plant: Plant,
    /// Command of each tick.
    pub commands: Vec<Command>,
    /// Sub-steps of these ticks.
    pub substeps: u64,
    /// Sub-steps with the implicit rule, near a contact or a joint's stop.
    pub contact_substeps: u64,
    /// Newton iterations of these ticks.
    pub newton_iterations: u64,
}

impl Replay {
    /// Replays all commands on a clone of [`Replay::plant`].
    ///
    /// # Errors
    /// [`PlantError`] if the plant's state is not finite, unlike in the recording.
    pub fn run(&self, plant: &mut Plant) -> Result<(), PlantError> {
        for command in &self.commands {
            plant.take(command);
            plant.advance()?;
        }
        Ok(())
    }
}

/// Returns the `ticks` consecutive ticks of a scenario with the most Newton iterations.
///
/// # Errors
/// [`RecordError`] if the scenario does not exist, cannot be simulated, or has fewer ticks.
pub fn costliest_stretch(scenario: &str, ticks: usize) -> Result<Replay, RecordError> {
    let settings = Settings::load(scenario, &[])?;
    let found = settings.duration_ticks;
    if found < ticks as u64 || ticks == 0 {
        return Err(RecordError::TooShort { scenario: scenario.to_owned(), found, expected: ticks.max(1) as u64 });
    }
    let mut simulation = Simulation::new(&settings)?;
    let mut cost = Vec::with_capacity(found as usize);
    for _ in 0..found {
        simulation.step()?;
        cost.push(u64::from(simulation.plant().last().physics.newton_iterations));
    }
    let mut sum: u64 = cost[..ticks].iter().sum();
    let (mut first, mut most) = (0, sum);
    for start in 1..=cost.len() - ticks {
        sum = sum + cost[start + ticks - 1] - cost[start - 1];
        if sum > most {
            (first, most) = (start, sum);
        }
    }
    record(&settings, first, ticks)
}

/// Returns the replay of a whole scenario.
///
/// # Errors
/// [`RecordError`] if the scenario does not exist or cannot be simulated.
pub fn whole_scenario(scenario: &str) -> Result<Replay, RecordError> {
    let settings = Settings::load(scenario, &[])?;
    record(&settings, 0, settings.duration_ticks as usize)
}

fn record(settings: &Settings, first: usize, ticks: usize) -> Result<Replay, RecordError> {
    let mut simulation = Simulation::new(settings)?;
    for _ in 0..first {
        simulation.step()?;
    }
    let mut replay = Replay {
        plant: simulation.plant().clone(),
        commands: Vec::with_capacity(ticks),
        substeps: 0,
        contact_substeps: 0,
        newton_iterations: 0,
    };
    for _ in 0..ticks {
        // A dead time of one tick: the command answers the previous state.
        replay.commands.push(simulation.snapshot().command);
        simulation.step()?;
        let physics = simulation.plant().last().physics;
        replay.substeps += u64::from(physics.substeps);
        replay.contact_substeps += u64::from(physics.contact_substeps);
        replay.newton_iterations += u64::from(physics.newton_iterations);
    }
    Ok(replay)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn replay_part_of_scenario_ends_in_simulated_state() {
        let settings = Settings::load("floor", &[]).unwrap();
        let replay = record(&settings, 2000, 300).unwrap();
        let mut plant = replay.plant.clone();
        replay.run(&mut plant).unwrap();
        let mut simulation = Simulation::new(&settings).unwrap();
        for _ in 0..2300 {
            simulation.step().unwrap();
        }
        assert_eq!(plant.sample(), simulation.plant().sample());
    }

    #[test]
    fn costliest_stretch_embedded_scenarios_counts_contact_substeps() {
        for scenario in ["floor", "box", "ball"] {
            let replay = costliest_stretch(scenario, 200).unwrap();
            assert_eq!(replay.commands.len(), 200);
            assert!(replay.contact_substeps > 1000, "{scenario}: {replay:?}");
            assert!(replay.substeps >= replay.contact_substeps && replay.newton_iterations > 0, "{scenario}");
        }
    }
}
