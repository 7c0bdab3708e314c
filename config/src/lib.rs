//! Scenarios: TOML as written, checked once into [`Settings`] that everything else trusts.
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
//! The way of a value: the text becomes a tree in which each value knows its line; other spellings of a key get their one
//! name; `--set` replaces values in the tree; the ranges are checked; serde reads the tree into the raw structures; what
//! several values have to fulfil together is checked last, and faults at random are drawn. A complaint therefore always
//! knows place, key and value.

mod alias;
mod change;
mod check;
mod embedded;
mod error;
mod fault;
mod inject;
mod load;
mod overrides;
mod policy;
mod ranges;
mod raw;
mod read;
mod schema;
mod settings;
mod tree;

pub use change::{Asked, Difference, differences};
pub use embedded::{Scenario, robots, scenarios};
pub use error::{Complaint, ConfigError, Location};
pub use fault::{Fault, FaultKind, FaultTarget};
pub use policy::{Fidelity, OnLoss, Placement, ResetPolicy, Saturation, Search};
pub use schema::json_schema;
pub use settings::{
    Floor, MAX_JOINTS, MAX_OBJECTS, MIN_SPACING_TICKS, Object, ObjectShape, OperatorChange, PERIOD_S, Parameters, Plant,
    Processes, Realtime, Recorder, Robot, Settings, Supervisor, Surface, Urdf, World,
};
