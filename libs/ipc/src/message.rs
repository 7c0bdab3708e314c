//! The messages of the stack: plain data, `repr(C)`, no pointers, the same in every process.
//!
//! Units are SI: m, rad (m for a prismatic joint), N, N m (N for a prismatic joint), s unless a name says otherwise. Vectors are
//! in the world frame, z up. Joint arrays hold [`MAX_JOINTS`] places, of which the first `joints` count.
//!
//! `stamp_ns` fields are readings of `CLOCK_MONOTONIC` and are zero in lockstep, where everything that is logged is a
//! function of scenario and seed.

pub use crate::codes::{
    Detector, Drive, EventKind, Mode, Phase, Process, ResetPolicy, Saturation, Search, Severity, Source, Tampering,
};
use iceoryx2::prelude::ZeroCopySend;

/// Most joints a robot may have.
pub const MAX_JOINTS: usize = 8;
/// Most free bodies a world may have.
pub const MAX_OBJECTS: usize = 4;
/// Most contacts a [`State`] reports.
pub const MAX_CONTACTS: usize = 8;
/// Most bytes of text in an [`Event`].
pub const EVENT_TEXT: usize = 192;

/// Pose and velocity of a free body.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
pub struct ObjectState {
    /// Centre of mass, m.
    pub position: [f64; 3],
    /// Unit quaternion, x y z w.
    pub orientation: [f64; 4],
    /// Velocity of the centre of mass, m/s.
    pub linear_velocity: [f64; 3],
    /// Angular velocity, rad/s.
    pub angular_velocity: [f64; 3],
}

/// One contact, averaged over the tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
pub struct ContactState {
    /// Index of the first body in the scene's list of bodies.
    pub body: u32,
    /// Index of the second body, which feels the opposite force.
    pub against: u32,
    /// Where, m: the mean over the tick, weighted by the force.
    pub point: [f64; 3],
    /// Mean force on the first body over the tick, N.
    pub force: [f64; 3],
    /// Deepest penetration at the start of the last sub-step in which they touched, m.
    pub depth: f64,
}

/// What the plant's integrator did in a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
pub struct Physics {
    /// Sub-steps in this tick.
    pub substeps: u32,
    /// Newton iterations in this tick, over all contact sub-steps.
    pub newton_iterations: u32,
    /// Contact sub-steps of this tick that ended above the tolerance.
    pub unconverged: u32,
    /// Sub-steps of this tick that were solved implicitly, in reach of a contact or a joint's stop.
    pub contact_substeps: u32,
    /// Kinetic and potential energy of robot and objects, J.
    pub energy_j: f64,
    /// Work done by the contacts (joint stops apart) on the bodies since the start, J: falls, but for what a compressed contact
    /// gives back.
    pub contact_work_j: f64,
    /// Elastic energy in the contacts now, J: with `contact_work_j` it may only fall; any rise is made by the integration.
    pub contact_stored_j: f64,
}

/// What the plant measured at `tick`, and what it did in the tick before.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[type_name("hapfic.State")]
#[repr(C)]
pub struct State {
    /// When it was published.
    pub stamp_ns: u64,
    /// Number of the sample; the first is 0.
    pub tick: i64,
    /// Simulated time, `tick` times the period.
    pub time_ns: u64,
    /// Tick of the command that was applied until this sample; -1 before the first.
    pub command_tick: i64,
    /// How late the plant's timer was; zero in lockstep.
    pub wake_lateness_ns: u64,
    /// Periods by which simulated time has slipped since the start, because the timer came late.
    pub slipped: u64,
    /// Joints that count.
    pub joints: u32,
    /// Code of [`Drive`]: what the drive did until this sample.
    pub drive: u32,
    /// Objects that count.
    pub object_count: u32,
    /// Contacts that count.
    pub contact_count: u32,
    /// q.
    pub joint_position: [f64; MAX_JOINTS],
    /// q'.
    pub joint_velocity: [f64; MAX_JOINTS],
    /// Mean torque the drive applied in the tick before.
    pub joint_torque: [f64; MAX_JOINTS],
    /// Tip of the chain, m.
    pub foot_position: [f64; 3],
    /// Its velocity, m/s.
    pub foot_velocity: [f64; 3],
    /// Mean force of the environment on the foot over the tick before, N: the sensor.
    pub foot_force: [f64; 3],
    /// Free bodies, in the order of the scenario.
    pub objects: [ObjectState; MAX_OBJECTS],
    /// Contacts.
    pub contacts: [ContactState; MAX_CONTACTS],
    /// The integrator's account.
    pub physics: Physics,
}

/// One axis of a planned motion: a closed form of the time since its target was accepted.
///
/// For `brake_time` it brakes with `brake_acceleration` from `start` at `start_velocity`; then
/// `x = target - amplitude (1 + cos(phase + rate t))` until the cosine's argument reaches pi, where it rests on the target.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
pub struct AxisPlan {
    /// Where it ends, m.
    pub target: f64,
    /// Position at acceptance, m.
    pub start: f64,
    /// Velocity at acceptance, m/s.
    pub start_velocity: f64,
    /// Signed acceleration while braking, m/s^2; zero if it need not brake.
    pub brake_acceleration: f64,
    /// How long it brakes, s.
    pub brake_time: f64,
    /// R, signed like the error at the start of the arc, m.
    pub amplitude: f64,
    /// omega, rad/s.
    pub rate: f64,
    /// theta_0, rad.
    pub phase: f64,
}

/// The planner's whole state: what it needs to go on after a restart.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
pub struct PlannerState {
    /// Ticks since the target was accepted.
    pub ticks: u64,
    /// The three axes.
    pub axes: [AxisPlan; 3],
}

/// Where the foot should be at `tick`.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[type_name("hapfic.Reference")]
#[repr(C)]
pub struct Reference {
    /// When it was published.
    pub stamp_ns: u64,
    /// The tick it is for.
    pub tick: i64,
    /// Version of the parameters it was made with.
    pub parameters_version: u64,
    /// x_d, m.
    pub position: [f64; 3],
    /// x_d', m/s.
    pub velocity: [f64; 3],
    /// The planner's state at `tick`.
    pub planner: PlannerState,
}

/// The controller's whole state. It travels in requests and commands; no controller keeps any.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
pub struct ControllerState {
    /// dx of the haptic search, m.
    pub offset: [f64; 3],
    /// Error latched at the start of the last convergence, m (eq. 1).
    pub x_max: [f64; 3],
    /// K0 of this tick, N/m; 0 before the first.
    pub stiffness: [f64; 3],
    /// F_max of this tick, N.
    pub max_force: [f64; 3],
    /// x_b of this tick, m.
    pub position_bound: [f64; 3],
    /// F_c of this tick, N.
    pub force: [f64; 3],
    /// 1 in convergence, 0 in divergence.
    pub converging: [u32; 3],
    /// Ticks in a row in which the axis stood still in convergence, without contact.
    pub still_ticks: [u32; 3],
}

/// What a controller asks for at `tick`.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[type_name("hapfic.Request")]
#[repr(C)]
pub struct Request {
    /// When it was published.
    pub stamp_ns: u64,
    /// The tick it is for.
    pub tick: i64,
    /// Tick of the state it was made from.
    pub state_tick: i64,
    /// Version of the parameters it was made with.
    pub parameters_version: u64,
    /// Code of the [`Process`] that made it.
    pub controller: u32,
    /// Joints that count.
    pub joints: u32,
    /// e = x_d + dx - x, m.
    pub error: [f64; 3],
    /// e' = x_d' - J q', m/s.
    pub error_rate: [f64; 3],
    /// F_c, N.
    pub force: [f64; 3],
    /// J^T F_c, and gravity compensation if asked for.
    pub torque: [f64; MAX_JOINTS],
    /// The controller's state after this tick.
    pub state: ControllerState,
}

/// What the gate passes to the drive at `tick`.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[type_name("hapfic.Command")]
#[repr(C)]
pub struct Command {
    /// When it was published.
    pub stamp_ns: u64,
    /// The tick whose state it answers.
    pub tick: i64,
    /// Code of [`Mode`].
    pub mode: u32,
    /// Code of [`Source`].
    pub source: u32,
    /// Code of [`Severity`].
    pub severity: u32,
    /// Joints that count.
    pub joints: u32,
    /// Bit i: the peak limited joint i.
    pub limited: u32,
    /// Bit i: the rate of joint i's torque is limited, ramping in after a brake.
    pub ramped: u32,
    /// Conditioned torque: filtered, limited in its rate after a brake, then in its size.
    pub torque: [f64; MAX_JOINTS],
    /// The accepted request: raw torque, force, error, controller state. The next tick's controller starts from here.
    pub request: Request,
}

/// One set of everything the operator may change while the stack runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[repr(C)]
pub struct Parameters {
    /// Counts up from 1.
    pub version: u64,
    /// First tick at which it is in force.
    pub effective_tick: i64,
    /// x_t, m.
    pub target_position: [f64; 3],
    /// F_d, wished reaction on the foot, N.
    pub desired_force: [f64; 3],
    /// K0, N/m.
    pub stiffness: [f64; 3],
    /// F_max, N.
    pub max_force: [f64; 3],
    /// x_b, m.
    pub position_bound: [f64; 3],
    /// Code of [`ResetPolicy`].
    pub reset_policy: u32,
    /// Code of [`Saturation`].
    pub saturation: u32,
    /// Code of [`Search`].
    pub search: u32,
    /// 1: add g(q) to the torque.
    pub gravity_compensation: u32,
    /// 1: dx does not wind up at F_max, and keeps its force when K0 changes.
    pub offset_anti_windup: u32,
    /// 1: a convergence that has come to a standstill starts anew from there.
    pub stall_release: u32,
    /// Share of the force error that the tapered search works off in 1 ms, as if against K0.
    pub taper: f64,
    /// sigma as the scale of the search step, Algorithm 1.
    pub search_scale: f64,
    /// sigma as the force threshold, Algorithm 1, N.
    pub force_resolution: f64,
    /// Desired mean speed of the planner, m/s.
    pub mean_speed: f64,
    /// a_max of the planner, m/s^2.
    pub max_acceleration: f64,
}

/// The parameters in force and those to come.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[type_name("hapfic.Operator")]
#[repr(C)]
pub struct Operator {
    /// In force when it was published.
    pub current: Parameters,
    /// In force from its `effective_tick` on; equal to `current` if nothing is announced.
    pub next: Parameters,
}

impl Operator {
    /// The parameters in force at a tick.
    #[must_use]
    pub fn at(&self, tick: i64) -> &Parameters {
        if tick >= self.next.effective_tick { &self.next } else { &self.current }
    }
}

/// Something that happened.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[type_name("hapfic.Event")]
#[repr(C)]
pub struct Event {
    /// When it was published.
    pub stamp_ns: u64,
    /// The tick it belongs to.
    pub tick: i64,
    /// Code of the [`Process`] it is about.
    pub process: u32,
    /// Code of [`EventKind`].
    pub kind: u32,
    /// Code of [`Severity`].
    pub severity: u32,
    /// Code of [`Detector`].
    pub detector: u32,
    /// Bytes of `text` that count.
    pub text_len: u32,
    /// Not used; zero.
    pub reserved: u32,
    /// UTF-8.
    pub text: [u8; EVENT_TEXT],
}

/// What a process did in a tick, by the wall clock; also its heartbeat.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[type_name("hapfic.Timing")]
#[repr(C)]
pub struct Timing {
    /// Code of [`Process`].
    pub process: u32,
    /// Code of [`Phase`].
    pub phase: u32,
    /// The tick it is about; -1 before the first.
    pub tick: i64,
    /// When the input that started the tick was published (plant: when its timer should have fired).
    pub due_ns: u64,
    /// When the process woke up.
    pub wake_ns: u64,
    /// When it had published its output; zero if it published none.
    pub publish_ns: u64,
    /// From state published to command published (gate), or to command received (plant); zero if it was not in time.
    pub latency_ns: u64,
    /// Heap allocations of the thread between receiving and sending, in this tick.
    pub allocations: u32,
    /// Messages refused since the start.
    pub refused: u32,
    /// Page faults of the thread since it began to run, minor and major.
    pub page_faults: u32,
    /// Real-time privileges in use, bits of [`crate::realtime::Granted`].
    pub realtime: u32,
    /// Which start of the process this is: 0 for the first.
    pub generation: u32,
    /// How often somebody who had joined could not be met, since the start.
    pub unmet: u32,
}

/// A fault that a process makes on purpose in what it sends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend)]
#[type_name("hapfic.Injection")]
#[repr(C)]
pub struct Injection {
    /// Counts up from 1: each is taken once.
    pub number: u64,
    /// First tick at which it is made; the next one if that has passed.
    pub tick: i64,
    /// Ticks for which it is made.
    pub ticks: u32,
    /// Code of the [`Process`] that makes it.
    pub process: u32,
    /// Code of [`Tampering`].
    pub tampering: u32,
    /// By how much a slow process is late, us.
    pub by_us: u32,
}

/// How far the recorder has taken everything in: in lockstep the plant may run ahead of it by a bounded number of ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
#[type_name("hapfic.Credit")]
#[repr(C)]
pub struct Credit {
    /// Last tick the plant may publish.
    pub tick: i64,
}
