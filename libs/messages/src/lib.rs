//! Messages of the stack: plain data, codes and checks, without a transport.
//!
//! Units are SI: m, rad (m for a prismatic joint), N, N m (N for a prismatic joint), s, unless a name states another.
//! Vectors are in the world frame, z up. Joint arrays hold [`MAX_JOINTS`] values, of which the first `joints` count.
//! `stamp_ns` fields are readings of `CLOCK_MONOTONIC`. They are zero in lockstep, where everything that is logged is a
//! function of scenario and seed.
//!
//! Read first [`State`], [`Reference`], [`Request`] and [`Command`]: the four messages of a tick. [`Operator`] carries
//! the parameters, [`Event`] and [`Timing`] report. `codes` gives the meaning of every code, `check` what each field
//! may hold.

mod check;
mod codes;
mod command;
mod event;
pub mod layout;
mod limits;
mod message;
mod operator_request;
mod parameters;
mod reference;
mod request;
mod run_mode;
mod state;
mod tick_buffer;
mod timing;
mod wire_enum;
mod wire_struct;

pub use check::{Check, ValidationError};
pub use codes::{
    Detector, Drive, EventKind, MessageFault, Mode, Phase, Process, ResetPolicy, Saturation, Search, Severity, Source, Task,
    TaskCondition,
};
pub use command::{Command, GateState};
pub use event::Event;
pub use limits::{CONTROL_DEPTH, EVENT_TEXT, MAX_CONTACTS, MAX_JOINTS, MAX_LIMBS, MAX_OBJECTS, PERIOD_NS};
pub use message::Message;
pub use operator_request::{OperatorKind, OperatorReply, OperatorRequest, REPLY_TEXT, REQUEST_TEXT, ReplyCode};
pub use parameters::{JointSpaceParameters, Operator, Parameters, RotationParameters};
pub use reference::{AxisPlan, PlannerState, Reference, RotationPlan};
pub use request::{ControllerState, Request, RotationRequest};
pub use run_mode::{Clock, RealtimeMode};
pub use state::{ContactState, ObjectState, Physics, State};
pub use tick_buffer::{TickBuffer, Ticked};
pub use timing::{Credit, Injection, Timing};
