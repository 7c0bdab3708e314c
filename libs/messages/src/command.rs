//! The gate's message to the drive.

use crate::limits::MAX_JOINTS;
use crate::message::Message;
use crate::request::Request;
use zerocopy::{FromBytes, Immutable, IntoBytes};

/// Command of the gate to the drive at `tick`.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
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
    /// The accepted request: raw torque, force, error, controller state. The next tick's controller starts from it.
    pub request: Request,
}

impl Message for Command {
    const NAME: &str = "hapfic.Command";
}
