//! HapFIC controller: haptic search, force profile, fractal attractor and the task-space law that combines them.
//!
//! All laws are pure functions of one axis of the world frame: state in, state and force out. Forces are in N, lengths
//! in m, times in s. Every output is finite, and no force exceeds `F_max`, for every parameter set.
//!
//! ```
//! use hapfic_controller::task_space::{self, TaskSpaceInput};
//! use hapfic_messages::{ControllerState, Parameters};
//!
//! let parameters = Parameters {
//!     stiffness: [2000.0; 3],
//!     max_force: [100.0; 3],
//!     position_bound: [0.05; 3],
//!     taper: 0.2,
//!     search_scale: 0.01,
//!     force_resolution: 0.01,
//!     ..Parameters::default()
//! };
//! let input = TaskSpaceInput { reference_position: [0.01, 0.0, 0.0], ..TaskSpaceInput::default() };
//! let output = task_space::step(ControllerState::default(), &input, &parameters, 1e-3)?;
//! assert_eq!(output.force, [20.0, 0.0, 0.0]);
//! # Ok::<(), hapfic_controller::task_space::TaskSpaceError>(())
//! ```

mod adaptive_taper;
mod anti_windup;
mod attractor;
mod axis;
pub mod control_step;
mod damping;
mod force_hold;
mod haptic;
pub mod joint_space;
pub mod orientation;
pub mod parameters;
mod profile;
mod stall_release;
pub mod task_space;
pub mod torque_filter;

pub use adaptive_taper::AdaptiveTaper;
pub use anti_windup::{bumpless_offset, conditional_integration};
pub use attractor::{Attractor, ContinuousAttractor};
pub use damping::damped;
pub use haptic::{HapticParameters, HapticSearch};
pub use profile::ForceProfile;
pub use stall_release::{Stall, StallInput};
pub use torque_filter::{LowPass, limit};
