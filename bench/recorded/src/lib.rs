//! What went through the stack in a scenario, kept for benchmarks: computed once in one process, then cycled through.
//!
//! [`moments`] gives what each part of the stack knew at a tick and what it made of it; [`costliest`] a plant and the
//! commands it lived through, to be lived through again.

mod moment;
mod replay;

pub use moment::{Moment, moments};
pub use replay::{Replay, costliest, whole};

use hapfic_config::ConfigError;
use hapfic_simulation::SimulationError;

/// Why there is nothing to measure.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The scenario cannot be loaded.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The scenario cannot be simulated.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// The plant cannot be built, or left the finite numbers.
    #[error(transparent)]
    Plant(#[from] hapfic_plant::PlantError),
    /// The scenario is shorter than the part that was asked for.
    #[error("scenario '{scenario}' has {found} ticks, expected at least {expected}; take a longer one")]
    TooShort {
        /// Its name.
        scenario: String,
        /// Its ticks.
        found: u64,
        /// Ticks that are needed.
        expected: u64,
    },
}
