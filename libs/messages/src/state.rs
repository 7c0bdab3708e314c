//! The plant's messages: the sampled robot, its objects and contacts.

use crate::limits::{MAX_CONTACTS, MAX_JOINTS, MAX_OBJECTS};
use crate::message::Message;
use crate::wire_struct::wire_struct;
use zerocopy::{FromBytes, Immutable, IntoBytes};

wire_struct! {
    /// Pose and velocity of a free body.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct ObjectState {
        /// Centre of mass [m].
        pub position: [f64; 3],
        /// Unit quaternion, x y z w.
        pub orientation: [f64; 4],
        /// Velocity of the centre of mass [m/s].
        pub linear_velocity: [f64; 3],
        /// Angular velocity [rad/s].
        pub angular_velocity: [f64; 3],
    }
}

wire_struct! {
    /// A contact, averaged over the tick.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct ContactState {
        /// Index of the first body in the scene's list of bodies.
        pub body: u32,
        /// Index of the second body, on which the opposite force acts.
        pub against: u32,
        /// Contact point [m]: the mean over the tick, weighted by the force.
        pub point: [f64; 3],
        /// Mean force on the first body over the tick [N].
        pub force: [f64; 3],
        /// Deepest penetration at the start of the last sub-step with contact [m].
        pub depth: f64,
    }
}

wire_struct! {
    /// Account of the plant's integrator over a tick.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct Physics {
        /// Sub-steps in this tick.
        pub substeps: u32,
        /// Newton iterations in this tick, over all contact sub-steps.
        pub newton_iterations: u32,
        /// Contact sub-steps of this tick that ended above the tolerance.
        pub unconverged: u32,
        /// Sub-steps of this tick that were solved implicitly, within reach of a contact or a joint's stop.
        pub contact_substeps: u32,
        /// Kinetic and potential energy of robot and objects [J].
        pub energy_j: f64,
        /// Work done by the contacts (without joint stops) on the bodies since the start [J]: falls, except for the energy
        /// that a compressed contact returns.
        pub contact_work_j: f64,
        /// Elastic energy in the contacts now [J]: its sum with `contact_work_j` may only fall; any rise comes from the
        /// integration.
        pub contact_stored_j: f64,
        /// Work of drive, brakes and joint stops on the joints since the start [J].
        pub joint_work_j: f64,
        /// Energy lost to joint damping since the start [J].
        pub joint_loss_j: f64,
        /// Error of the energy balance since the start [J]: the change of `energy_j` less the works of contacts and joints,
        /// plus the loss to joint damping.
        pub energy_error_j: f64,
        /// Sub-steps of this tick that were rolled back and cut, since they did not converge or would have added energy.
        pub cut_substeps: u32,
        /// Passages in this tick: the centre of a body came out on the other side of another body's.
        pub passages: u32,
        /// Index of the body of the last passage in the scene's list of bodies.
        pub passed_body: u32,
        /// Index of the body that it passed through.
        pub passed_against: u32,
    }
}

wire_struct! {
    /// Measurements of the plant at `tick`, and its actions in the tick before.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct State {
        /// Publication time [ns].
        pub stamp_ns: u64,
        /// Number of the sample; the first is 0.
        pub tick: i64,
        /// Simulated time [ns], `tick` times the period.
        pub time_ns: u64,
        /// Tick of the command that was applied until this sample; -1 before the first.
        pub command_tick: i64,
        /// Lateness of the plant's timer [ns]; zero in lockstep.
        pub wake_lateness_ns: u64,
        /// Periods by which simulated time has slipped since the start, because the timer was late.
        pub slipped: u64,
        /// Joints that count.
        pub joints: u32,
        /// Code of [`Drive`](crate::Drive): action of the drive until this sample.
        pub drive: u32,
        /// Objects that count.
        pub object_count: u32,
        /// Contacts that count.
        pub contact_count: u32,
        /// Limbs in this message: 1.
        pub limbs: u32,
        /// Not used; zero.
        pub reserved: u32,
        /// q [rad].
        pub joint_position: [f64; MAX_JOINTS],
        /// q' [rad/s].
        pub joint_velocity: [f64; MAX_JOINTS],
        /// Mean torque of the drive in the tick before [N m].
        pub joint_torque: [f64; MAX_JOINTS],
        /// Tip of the chain [m].
        pub foot_position: [f64; 3],
        /// Its velocity [m/s].
        pub foot_velocity: [f64; 3],
        /// Mean force of the environment on the foot over the tick before [N]: the sensor.
        pub foot_force: [f64; 3],
        /// Orientation of the tip frame in the world: unit quaternion, x y z w.
        pub foot_orientation: [f64; 4],
        /// Its angular velocity [rad/s].
        pub foot_angular_velocity: [f64; 3],
        /// Mean moment of the environment on the foot about the tip over the tick before [N m]: the sensor's other half.
        pub foot_moment: [f64; 3],
        /// Free bodies, in the order of the scenario.
        pub objects: [ObjectState; MAX_OBJECTS],
        /// Contacts.
        pub contacts: [ContactState; MAX_CONTACTS],
        /// The integrator's account.
        pub physics: Physics,
    }
}

impl Message for State {
    const NAME: &str = "hapfic.State";
}
