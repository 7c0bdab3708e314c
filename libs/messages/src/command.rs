//! The gate's message to the drive.

use crate::limits::MAX_JOINTS;
use crate::message::Message;
use crate::request::Request;
use crate::wire_struct::wire_struct;
use zerocopy::{FromBytes, Immutable, IntoBytes};

wire_struct! {
    /// Command of the gate to the drive at `tick`.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct Command {
        /// Publication time [ns].
        pub stamp_ns: u64,
        /// Tick of the state that it answers.
        pub tick: i64,
        /// Code of [`Mode`](crate::Mode).
        pub mode: u32,
        /// Code of [`Source`](crate::Source).
        pub source: u32,
        /// Code of [`Severity`](crate::Severity).
        pub severity: u32,
        /// Joints that count.
        pub joints: u32,
        /// Bit i: the torque of joint i was beyond its peak. If the gate scales, all joints are scaled.
        pub limited: u32,
        /// Bit i: the rate of joint i's torque was limited, ramping in after a brake.
        pub ramped: u32,
        /// Bit i: the rate of joint i's torque was beyond the limit of normal operation.
        pub rate_limited: u32,
        /// Limbs in this message: 1.
        pub limbs: u32,
        /// Conditioned torque [N m]: filtered, limited in its rate and in its size.
        pub torque: [f64; MAX_JOINTS],
        /// State of the gate after this command, from which any gate continues.
        pub gate: GateState,
        /// The accepted request: raw torque, force, error, controller state. The next tick's controller starts from it.
        pub request: Request,
    }
}

wire_struct! {
    /// State of the gate after a command. Of each gate the next command follows from it and from the next request alone.
    #[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
    pub struct GateState {
        /// Output of the torque filter [N m; N for a prismatic joint].
        pub filtered: [f64; MAX_JOINTS],
        /// Latched stops that the gate has taken in.
        pub stops: u64,
        /// Re-armings that the gate has taken in.
        pub rearms: u64,
        /// Version of the newest parameter set that was announced before the command went out.
        pub announced: u64,
        /// Whether the torque ramps in after a brake.
        pub ramping: u32,
        /// Slot of the primary controller.
        pub primary: u32,
        /// Ticks in a row that only the other slot answered.
        pub misses: u32,
        /// Ticks in a row without a valid request, up to those that brake.
        pub missed: u32,
        /// Ticks in a row with a valid request, up to those that clear a brake.
        pub good: u32,
        /// Whether any request has been used.
        pub opened: u32,
    }
}

impl Message for Command {
    const NAME: &str = "hapfic.Command";
}
