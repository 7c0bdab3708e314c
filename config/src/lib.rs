//! Scenarios: TOML as written, checked once into [`Settings`]. All other crates trust the checked values.
//!
//! ```
//! use hapfic_config::Settings;
//!
//! let settings = Settings::load("floor", &["controller.taper=0.1".to_owned()])?;
//! assert_eq!(settings.duration_ticks, 10_000);
//! assert_eq!(settings.initial.taper, 0.1);
//! # Ok::<(), hapfic_config::ConfigError>(())
//! ```
//!
//! Stages of loading:
//! 1. The parser turns the text into a tree that keeps the line of each value.
//! 2. Aliases of keys become their names; `--set` replaces values in the tree.
//! 3. The range of every number is checked; serde reads the tree into the raw structures.
//! 4. Conditions between several values are checked, and random faults are sampled.
//!
//! Every error message therefore names place, key and value.

mod alias;
mod change;
mod check;
mod embedded;
mod error;
mod fault;
mod hint;
mod inject;
mod load;
mod overrides;
mod parameters;
mod places;
mod policy;
mod ranges;
mod raw;
mod read;
mod schema;
mod settings;
mod tree;

pub use change::{ParameterDifference, RequestedChange, differences, parameter_lines};
pub use embedded::{Scenario, robots, scenarios};
pub use error::{ConfigError, Diagnostic, Location};
pub use fault::{Fault, FaultKind, FaultTarget};
pub use parameters::{JointSpaceSettings, OperatorChange, ParameterSettings, RotationSettings};
pub use policy::{Fidelity, OnFailure, OnLoss, Placement, ResetPolicy, Saturation, Search, Task, TorqueSaturation};
pub use schema::json_schema;
pub use settings::{
    EngineSettings, ExternalProcesses, Floor, Foot, JointValues, MAX_JOINTS, MAX_OBJECTS, MAX_SPHERES, MIN_SPACING_TICKS, Object,
    ObjectShape, PERIOD_S, PlantSettings, RapierSettings, RealtimeSettings, RecorderSettings, RobotSettings, Settings,
    SupervisorSettings, Surface, Urdf, WorldSettings,
};
