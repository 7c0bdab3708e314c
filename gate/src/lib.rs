//! Torque gate: which request becomes the command of a tick. Pure: no clock, no transport, no heap.
//!
//! Read [`gate`] first: it validates requests, conditions the torque and keeps the last command. [`protocol`] decides which controller
//! answers a tick, [`severity`] how bad the situation is, [`torque_check`] whether a torque agrees with its force,
//! [`parameter_schedule`] at which tick a change of parameters takes effect, and [`restart`] when a lost process is started again.
//! `tests/protocol` explores protocol, severity and restarts exhaustively.

pub mod gate;
mod limits;
pub mod parameter_schedule;
pub mod protocol;
pub mod restart;
pub mod severity;
pub mod torque_check;

pub use gate::{Gate, TorqueStep};
pub use limits::Limits;
pub use parameter_schedule::ParameterSchedule;
pub use torque_check::TorqueCheck;
