//! The controller's message: a requested torque and the controller's state.

use crate::limits::MAX_JOINTS;
use crate::message::Message;
use crate::wire_struct::wire_struct;
use zerocopy::{FromBytes, Immutable, IntoBytes};

wire_struct! {
    /// State of the law on three axes. It travels in requests and commands; controllers keep none.
    ///
    /// The units are those of the translation. The same fields hold the state of the three axes of rotation, in rad for m and
    /// N m for N.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
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
}

wire_struct! {
    /// The orientation's part of a request: zero in a position task.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct RotationRequest {
        /// e_R: rotation vector from the tip to the reference, plus the searched offset [rad].
        pub error: [f64; 3],
        /// e_R' = omega_d - omega [rad/s].
        pub error_rate: [f64; 3],
        /// Moment [N m].
        pub moment: [f64; 3],
        /// The law's state after this tick.
        pub state: ControllerState,
    }
}

wire_struct! {
    /// Request of a controller at `tick`.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
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
        /// Limbs in this message: 1.
        pub limbs: u32,
        /// Not used; zero.
        pub reserved: u32,
        /// e = x_d + dx - x [m].
        pub error: [f64; 3],
        /// e' = x_d' - J q' [m/s].
        pub error_rate: [f64; 3],
        /// F_c [N].
        pub force: [f64; 3],
        /// `J^T W + tau_N`, plus gravity compensation if enabled [N m]; W: force and moment.
        pub torque: [f64; MAX_JOINTS],
        /// tau_N, the part of `torque` that acts on the posture: null space, joint damping, limit springs [N m].
        pub joint_space_torque: [f64; MAX_JOINTS],
        /// The law's state after this tick.
        pub state: ControllerState,
        /// The orientation.
        pub rotation: RotationRequest,
    }
}

impl Message for Request {
    const NAME: &str = "hapfic.Request";
}
