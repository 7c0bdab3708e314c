//! Torque gate: decides which request becomes the command of a tick. Pure: no clock, no transport, no heap.
//!
//! Read [`gate`] first: it validates requests, conditions the torque and keeps the last command. [`conditioning`] filters
//! a torque and limits its rate and size. [`protocol`] decides which controller answers a tick, and [`severity`] how severe
//! the situation is. [`torque_check`] compares a torque with its force. [`parameter_schedule`] decides at which tick a change of parameters takes effect, and [`restart_policy`]
//! when the supervisor restarts a lost process. `tests/protocol` explores protocol, severity and restarts exhaustively.

pub mod conditioning;
pub mod gate;
mod limits;
pub mod pair;
pub mod parameter_schedule;
pub mod parameter_settings;
pub mod protocol;
pub mod restart_policy;
pub mod severity;
pub mod torque_check;

pub use gate::{Gate, TorqueStep};
pub use limits::GateLimits;
pub use parameter_schedule::ParameterSchedule;
pub use torque_check::TorqueCheck;
