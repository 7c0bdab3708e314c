//! A model-based operational-space controller that solves a quadratic programme (QP) in each tick: what the tick of HapFIC's
//! controller, which has no model of contact and solves nothing, is measured beside.
//!
//! Decision variables are joint accelerations, torques and the normal force of the contact; the equations of motion are its
//! equality constraint, torque limits and a contact that cannot pull its inequalities ([`qp`]). It tracks the same reference on
//! the same leg, and presses with the same desired force ([`OperationalSpace`]).

mod acceleration;
mod error;
mod operational_space;
pub mod qp;

pub use acceleration::tip_bias_acceleration;
pub use error::QpError;
pub use operational_space::{Gains, OperationalSpace, Solution, Task};
