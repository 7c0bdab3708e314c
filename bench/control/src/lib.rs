//! A model-based operational-space controller that solves a quadratic programme (QP) in each tick.
//!
//! The benchmarks compare it with the controller of HapFIC, which has no contact model and solves no programme.
//! Decision variables are joint accelerations, torques and the normal force of the contact. The equations of motion are
//! the equality constraint; torque limits and a contact that cannot pull are the inequalities ([`qp`]). The controller
//! tracks the same reference on the same leg, and presses with the same desired force ([`OperationalSpace`]).

mod acceleration;
mod error;
mod operational_space;
pub mod qp;

pub use acceleration::tip_bias_acceleration;
pub use error::QpError;
pub use operational_space::{Gains, OperationalSpace, QpSolution, Task};
