//! The planner's message: the reference of a tick and the planner's state.

use crate::message::Message;
use crate::wire_struct::wire_struct;
use zerocopy::{FromBytes, Immutable, IntoBytes};

wire_struct! {
    /// Planned motion of an axis: a closed form of the time since its target was accepted.
    ///
    /// For `brake_time` the axis brakes with `brake_acceleration` from `start` at `start_velocity`; then `x = target -
    /// amplitude (1 + cos(phase + rate t))` until the cosine's argument reaches pi, where it rests on the target.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct AxisPlan {
        /// End position [m].
        pub target: f64,
        /// Position at acceptance [m].
        pub start: f64,
        /// Velocity at acceptance [m/s].
        pub start_velocity: f64,
        /// Signed acceleration while braking [m/s^2]; zero if it need not brake.
        pub brake_acceleration: f64,
        /// Duration of braking [s].
        pub brake_time: f64,
        /// R, signed like the error at the start of the arc [m].
        pub amplitude: f64,
        /// omega [rad/s].
        pub rate: f64,
        /// theta_0 [rad].
        pub phase: f64,
    }
}

wire_struct! {
    /// Planned turn of the tip: the rotation vector r from the target to the reference, axis by axis as a position.
    ///
    /// The reference is `R_d = exp(r) R_t`, world frame. From rest r keeps its direction, and the turn is that of a slerp.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct RotationPlan {
        /// Ticks since the target was accepted.
        pub ticks: u64,
        /// 1: there is a plan; 0 in a position task, and where the plant does not measure the orientation.
        pub exists: u64,
        /// Target: roll, pitch, yaw about the fixed axes [rad].
        pub target_rpy: [f64; 3],
        /// The three components of r; each ends at 0 [rad].
        pub axes: [AxisPlan; 3],
    }
}

wire_struct! {
    /// Whole state of the planner, from which it continues after a restart.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct PlannerState {
        /// Ticks since the target was accepted.
        pub ticks: u64,
        /// The three axes.
        pub axes: [AxisPlan; 3],
        /// The orientation; zero in a position task.
        pub rotation: RotationPlan,
    }
}

wire_struct! {
    /// Planned position of the foot at `tick`.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct Reference {
        /// Publication time [ns].
        pub stamp_ns: u64,
        /// Tick of the reference.
        pub tick: i64,
        /// Version of its parameters.
        pub parameters_version: u64,
        /// Limbs in this message: 1.
        pub limbs: u32,
        /// Not used; zero.
        pub reserved: u32,
        /// x_d [m].
        pub position: [f64; 3],
        /// x_d' [m/s].
        pub velocity: [f64; 3],
        /// R_d: unit quaternion x y z w; all zero in a position task.
        pub orientation: [f64; 4],
        /// Its angular velocity [rad/s].
        pub angular_velocity: [f64; 3],
        /// The planner's state at `tick`.
        pub planner: PlannerState,
    }
}

impl Message for Reference {
    const NAME: &str = "hapfic.Reference";
}
