//! Recorded inputs of benchmarks: the messages of a scenario, simulated once in one process.
//!
//! [`recorded_ticks`] returns inputs and outputs of planner, controller and gate at single ticks. [`costliest_stretch`]
//! and [`whole_scenario`] return a plant and the commands to replay on it.

mod moment;
mod replay;

pub use moment::{RecordedTick, recorded_ticks};
pub use replay::{Replay, costliest_stretch, whole_scenario};

use hapfic_config::ConfigError;
use hapfic_simulation::SimulationError;

/// Error of recording a scenario.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The scenario cannot be loaded.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The scenario cannot be simulated.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// The plant cannot be built, or its state is not finite.
    #[error(transparent)]
    Plant(#[from] hapfic_plant::PlantError),
    /// The scenario is shorter than the requested part.
    #[error("scenario '{scenario}' has {found} ticks, expected at least {expected}; take a longer one")]
    TooShort {
        /// Name of the scenario.
        scenario: String,
        /// Length of the scenario [ticks].
        found: u64,
        /// Requested length [ticks].
        expected: u64,
    },
}
