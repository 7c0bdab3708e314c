//! The controller's message: a requested torque and the controller's state.

use crate::limits::MAX_JOINTS;
use crate::message::Message;
use zerocopy::{FromBytes, Immutable, IntoBytes};

/// Whole state of the controller. It travels in requests and commands; controllers keep none.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct ControllerState {
    /// dx of the haptic search [m].
    pub offset: [f64; 3],
    /// Error latched at the start of the last convergence [m] (eq. 1).
    pub x_max: [f64; 3],
    /// K0 of this tick [N/m]; 0 before the first.
    pub stiffness: [f64; 3],
    /// F_max of this tick [N].
    pub max_force: [f64; 3],
    /// x_b of this tick [m].
    pub position_bound: [f64; 3],
    /// Force of the attractor in this tick [N], without damping.
    pub force: [f64; 3],
    /// Taper of the adaptive search, 0 before the first contact.
    pub taper: [f64; 3],
    /// F_d - F of this tick [N]; 0 without contact.
    pub force_error: [f64; 3],
    /// |F_d - F| smoothed over 20 ms [N]; 0 before the first contact.
    pub slow_error: [f64; 3],
    /// Time since the last contact [s], at most 1.
    pub free_time: [f64; 3],
    /// Force of the attractor at x_max [N], with continuous re-entry.
    pub x_max_force: [f64; 3],
    /// 1 in convergence, 0 in divergence.
    pub converging: [u32; 3],
    /// Ticks in a row in which the axis was at rest in convergence, without contact.
    pub at_rest_ticks: [u32; 3],
}

/// Request of a controller at `tick`.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Request {
    /// Publication time [ns].
    pub stamp_ns: u64,
    /// Tick of the request.
    pub tick: i64,
    /// Tick of its state.
    pub state_tick: i64,
    /// Version of its parameters.
    pub parameters_version: u64,
    /// Code of the [`Process`](crate::Process) that sends it.
    pub controller: u32,
    /// Joints that count.
    pub joints: u32,
    /// e = x_d + dx - x [m].
    pub error: [f64; 3],
    /// e' = x_d' - J q' [m/s].
    pub error_rate: [f64; 3],
    /// F_c [N].
    pub force: [f64; 3],
    /// J^T F_c, plus gravity compensation if enabled [N m].
    pub torque: [f64; MAX_JOINTS],
    /// The controller's state after this tick.
    pub state: ControllerState,
}

impl Message for Request {
    const NAME: &str = "hapfic.Request";
}
