//! The operator's parameter sets: in force and announced.

use crate::command::Command;
use crate::limits::MAX_JOINTS;
use crate::message::Message;
use crate::state::State;
use crate::wire_struct::wire_struct;
use zerocopy::{FromBytes, Immutable, IntoBytes};

wire_struct! {
    /// Parameters of the axes of rotation; read in a pose task alone.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct RotationParameters {
        /// Desired orientation of the tip: roll, pitch, yaw about the fixed axes, as in URDF [rad].
        pub target_rpy: [f64; 3],
        /// Desired moment of the environment on the foot about the tip [N m]; 0 on an axis: no search there.
        pub desired_moment: [f64; 3],
        /// K_R [N m/rad].
        pub stiffness: [f64; 3],
        /// T_max [N m].
        pub max_moment: [f64; 3],
        /// x_b,R [rad].
        pub bound: [f64; 3],
        /// Damping of each axis over the square root of its stiffness [kg^1/2 m].
        pub damping: f64,
        /// sigma as the moment threshold of the search [N m].
        pub moment_resolution: f64,
        /// Desired mean speed of a turn [rad/s].
        pub mean_speed: f64,
        /// Largest angular acceleration of the reference [rad/s^2].
        pub max_acceleration: f64,
    }
}

wire_struct! {
    /// Parameters of the law in joint space, fixed over a run. All gains zero: there is none.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct JointSpaceParameters {
        /// q_n, desired posture [rad; m for a prismatic joint].
        pub posture: [f64; MAX_JOINTS],
        /// K_n, stiffness of the posture in the null space [N m/rad].
        pub stiffness: f64,
        /// D_n, damping in the null space [N m s/rad].
        pub damping: f64,
        /// Damping of every joint, in the task too [N m s/rad].
        pub joint_damping: f64,
        /// Distance from a joint's limit at which its spring begins [rad].
        pub limit_margin: f64,
        /// Stiffness of the limit springs [N m/rad].
        pub limit_stiffness: f64,
    }
}

wire_struct! {
    /// Parameter set: everything that the operator may change while the stack runs.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct Parameters {
        /// Version, counted from 1.
        pub version: u64,
        /// First tick of the set.
        pub effective_tick: i64,
        /// x_t [m].
        pub target_position: [f64; 3],
        /// F_d, desired reaction on the foot [N].
        pub desired_force: [f64; 3],
        /// K0 [N/m].
        pub stiffness: [f64; 3],
        /// F_max [N].
        pub max_force: [f64; 3],
        /// x_b [m].
        pub position_bound: [f64; 3],
        /// Code of [`ResetPolicy`](crate::ResetPolicy).
        pub reset_policy: u32,
        /// Code of [`Saturation`](crate::Saturation).
        pub saturation: u32,
        /// Code of [`Search`](crate::Search).
        pub search: u32,
        /// 1: add g(q) to the torque.
        pub gravity_compensation: u32,
        /// 1: dx does not wind up at F_max, and keeps its force when K0 changes.
        pub offset_anti_windup: u32,
        /// 1: a stalled convergence restarts from its position.
        pub stall_release: u32,
        /// 1: in contact dx follows the reference and a change of gains keeps the force; after a loss of contact dx returns
        /// slowly.
        pub force_hold: u32,
        /// 1: the force is continuous where the attractor enters divergence again.
        pub continuous_reentry: u32,
        /// Code of [`Task`](crate::Task); the same over a run.
        pub task: u32,
        /// Joints that count in the posture.
        pub joints: u32,
        /// Share of the force error that the tapered search removes in 1 ms, as if against K0.
        pub taper: f64,
        /// Damping of each axis over the square root of its stiffness [kg^1/2].
        pub damping: f64,
        /// Time by which the posture of J^T is predicted [s].
        pub posture_lead: f64,
        /// sigma as the scale of the search step, Algorithm 1.
        pub search_scale: f64,
        /// sigma as the force threshold, Algorithm 1 [N].
        pub force_resolution: f64,
        /// Desired mean speed of the planner [m/s].
        pub mean_speed: f64,
        /// a_max of the planner [m/s^2].
        pub max_acceleration: f64,
        /// The axes of rotation.
        pub rotation: RotationParameters,
        /// The law in joint space.
        pub joint_space: JointSpaceParameters,
    }
}

impl JointSpaceParameters {
    /// Whether any gain is set.
    #[must_use]
    pub fn acts(&self) -> bool {
        self.stiffness > 0.0 || self.damping > 0.0 || self.joint_damping > 0.0 || self.limit_stiffness > 0.0
    }
}

impl Parameters {
    /// Whether the orientation is controlled.
    #[must_use]
    pub fn is_pose(&self) -> bool {
        self.task == crate::Task::Pose.code()
    }

    /// The parameters of the law on the axes of rotation, in rad for m and N m for N.
    #[must_use]
    pub fn of_rotation(&self) -> Self {
        let r = &self.rotation;
        Self {
            desired_force: r.desired_moment,
            stiffness: r.stiffness,
            max_force: r.max_moment,
            position_bound: r.bound,
            damping: r.damping,
            force_resolution: r.moment_resolution,
            ..*self
        }
    }

    /// Posture at the time at which the torque that answers a state acts: q + q' `posture_lead` [rad].
    ///
    /// In the dead time the lever arms change. Near a straight joint this feeds energy into the joint's motion: a force F
    /// along links of lengths a and b, tau late, acts on that joint as the negative damping F tau a b / (a + b).
    #[must_use]
    pub fn predicted_posture(&self, state: &State) -> [f64; MAX_JOINTS] {
        core::array::from_fn(|i| state.joint_position[i] + self.posture_lead * state.joint_velocity[i])
    }
}

wire_struct! {
    /// Parameter sets in force and announced.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct Operator {
        /// Set in force at publication.
        pub current: Parameters,
        /// Set in force from its `effective_tick` on; equal to `current` if nothing is announced.
        pub next: Parameters,
    }
}

impl Operator {
    /// The parameters in force at a tick.
    #[must_use]
    pub fn at(&self, tick: i64) -> &Parameters {
        if tick >= self.next.effective_tick { &self.next } else { &self.current }
    }

    /// Whether these are the sets announced before a command went out, or newer ones. Older ones, which come from the
    /// history of the other gate, do not hold for the ticks after it.
    #[must_use]
    pub fn includes(&self, command: &Command) -> bool {
        self.next.version >= command.gate.announced
    }

    /// Replaces older sets, or none, by new ones: the history of a gate that was active before may come last.
    pub fn take_newer(sets: &mut Option<Self>, new: Self) {
        if sets.is_none_or(|sets| new.next.version >= sets.next.version) {
            *sets = Some(new);
        }
    }
}

impl Message for Operator {
    const NAME: &str = "hapfic.Operator";
}
