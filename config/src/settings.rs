//! A checked scenario.

use crate::fault::Fault;
use crate::parameters::{OperatorChange, ParameterSettings};
use crate::places::Places;
use crate::policy::{Fidelity, OnFailure, OnLoss, Placement, TorqueSaturation};

/// Period T of the control loop [s].
pub const PERIOD_S: f64 = 0.001;

/// Most joints a robot may have.
pub const MAX_JOINTS: usize = 16;

/// Most objects a world may have.
pub const MAX_OBJECTS: usize = 4;

/// Fewest ticks between two entries of the operator: the lead time of a change's announcement.
pub const MIN_SPACING_TICKS: i64 = 5;

/// A scenario after all checks: every number is finite and in its range, and all values fit together.
///
/// Overrides change a scenario, not these fields: [`Settings::effective_toml`] returns the scenario as loaded.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Summary in one line.
    pub title: String,
    /// Purpose of the scenario.
    pub description: String,
    /// Length, in ticks of [`PERIOD_S`]; at least 1.
    pub duration_ticks: u64,
    /// Seed of all random numbers.
    pub seed: u64,
    /// The robot.
    pub robot: RobotSettings,
    /// Surroundings of the robot.
    pub world: WorldSettings,
    /// The simulated plant.
    pub plant: PlantSettings,
    /// Preset of the controller's policies.
    pub fidelity: Fidelity,
    /// Parameters from the first tick on: controller, planner, and the operator's entry at 0 if there is one.
    pub initial: ParameterSettings,
    /// Later changes by the operator, in the order of time; all ticks are above 0.
    pub operator: Vec<OperatorChange>,
    /// Injected faults, sampled, in the order of time; all ticks are within the run.
    pub faults: Vec<Fault>,
    /// Gate and watchdog.
    pub supervisor: SupervisorSettings,
    /// Priorities and cores.
    pub realtime: RealtimeSettings,
    /// The log.
    pub recorder: RecorderSettings,
    /// External processes.
    pub processes: ExternalProcesses,
    pub(crate) effective: String,
    pub(crate) places: Places,
}

/// The robot, its place in the world, and its posture at the start.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotSettings {
    /// Robot description.
    pub urdf: Urdf,
    /// Link that is fixed to the world.
    pub base_link: String,
    /// Link whose frame is the foot.
    pub tip_link: String,
    /// Position of the base link in the world frame [m].
    pub base_position_m: [f64; 3],
    /// Orientation of the base link: roll, pitch, yaw [rad].
    pub base_orientation_rpy_rad: [f64; 3],
    /// q at the start, base to tip [rad; m for prismatic joints]; 1 to [`MAX_JOINTS`] numbers. The robot model compares
    /// their number with the description.
    pub start_position: Vec<f64>,
    /// Joint damping [N m s/rad; N s/m]; `None`: the description's. The robot model compares the number of values, or the
    /// names, with the description, here and below.
    pub joint_damping: Option<JointValues>,
    /// Effort limit [N m; N]; `None`: the description's.
    pub effort_limit: Option<JointValues>,
    /// Speed limit [rad/s; m/s]; `None`: the description's.
    pub velocity_limit: Option<JointValues>,
    /// Coulomb friction [N m; N]; `None`: the description's.
    pub joint_friction: Option<JointValues>,
    /// Inertia of the rotors at the joints [kg m^2; kg]; `None`: none.
    pub armature: Option<JointValues>,
    /// Foot in place of the tip link's shapes.
    pub foot: Option<Foot>,
}

/// Numbers for the joints of a robot.
#[derive(Clone, Debug, PartialEq)]
pub enum JointValues {
    /// One for each, base to tip.
    InOrder(Vec<f64>),
    /// Some by the names of the joints.
    ByName(Vec<(String, f64)>),
}

/// Foot of a robot.
#[derive(Clone, Debug, PartialEq)]
pub enum Foot {
    /// Spheres of one radius.
    Spheres {
        /// Radius [m].
        radius_m: f64,
        /// Centres in the tip frame [m]; 1 to [`MAX_SPHERES`].
        centers_m: Vec<[f64; 3]>,
    },
    /// A box along the axes of the tip frame.
    Box {
        /// Edges along x, y, z [m].
        size_m: [f64; 3],
        /// Centre in the tip frame [m].
        offset_m: [f64; 3],
    },
}

/// Maximum number of spheres of a foot.
pub const MAX_SPHERES: usize = 8;

/// Loaded robot description.
#[derive(Clone, Debug, PartialEq)]
pub struct Urdf {
    /// File, or name of the embedded description, for messages.
    pub name: String,
    /// The XML.
    pub text: String,
}

/// Surroundings of the robot.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldSettings {
    /// Gravity in the world frame [m/s^2].
    pub gravity_m_per_s2: [f64; 3],
    /// The floor, if there is one.
    pub floor: Option<Floor>,
    /// Free bodies, at most [`MAX_OBJECTS`].
    pub objects: Vec<Object>,
}

/// A level floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Floor {
    /// Height z of the floor [m].
    pub height_m: f64,
    /// Whether only the tip link touches it, for presses in any posture; false in every scenario.
    pub tip_only: bool,
    /// Contact law.
    pub surface: Surface,
}

/// A free body.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Name, unique among the objects.
    pub name: String,
    /// Shape and size.
    pub shape: ObjectShape,
    /// Mass [kg], uniformly distributed over the shape.
    pub mass_kg: f64,
    /// Position of the centre at the start in the world frame [m].
    pub position_m: [f64; 3],
    /// Orientation at the start: roll, pitch, yaw [rad].
    pub orientation_rpy_rad: [f64; 3],
    /// Contact law.
    pub surface: Surface,
}

/// Shape and size of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ObjectShape {
    /// A box with its edges along x, y and z.
    Box {
        /// Lengths of the edges [m].
        size_m: [f64; 3],
    },
    /// A ball.
    Ball {
        /// Radius [m].
        radius_m: f64,
    },
}

/// Contact law of a body's surface.
///
/// A contact has k, b and w of the softer surface, and mu_s, mu_d and v_c of the more slippery one. A robot's links
/// have the surface of the body they touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Stiffness k [N/m].
    pub stiffness_n_per_m: f64,
    /// Damping b [N s/m].
    pub damping_n_s_per_m: f64,
    /// Transition width w [m].
    pub transition_width_m: f64,
    /// Static friction mu_s.
    pub friction_static: f64,
    /// Dynamic friction mu_d, at most mu_s.
    pub friction_dynamic: f64,
    /// Critical speed v_c [m/s].
    pub critical_speed_m_per_s: f64,
}

/// Integration and drive of the simulated plant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlantSettings {
    /// Longest step in contact [us]; need not divide the period.
    pub contact_substep_us: u32,
    /// Longest step in free flight [us]; need not divide the period.
    pub flight_substep_us: u32,
    /// Physics engine.
    pub engine: EngineSettings,
    /// Ticks without a command after which the drive brakes.
    pub command_timeout_ticks: u32,
    /// Damping while braking [N m s/rad].
    pub brake_damping_n_m_s_per_rad: f64,
    /// Standard deviation of the force sensor's noise on each axis [N].
    pub force_noise: f64,
    /// Reaction of the run to the loss of the plant.
    pub on_loss: OnLoss,
}

/// Physics engine of the plant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EngineSettings {
    /// The plant's own.
    Hapfic,
    /// rapier.
    Rapier(RapierSettings),
}

/// Settings of the engine rapier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RapierSettings {
    /// Longest step [us].
    pub substep_us: u32,
    /// Natural frequency of the contacts [Hz].
    pub frequency_hz: f64,
    /// Damping ratio of the contacts.
    pub damping_ratio: f64,
}

/// The torque gate and the watchdog.
#[derive(Clone, Debug, PartialEq)]
pub struct SupervisorSettings {
    /// Time that the gate waits for a request after the state [us].
    pub deadline_us: u32,
    /// Bandwidth of the torque filter [Hz]; `None`: no filter.
    pub torque_bandwidth_hz: Option<f64>,
    /// Peak after the filter [N m; N], one number for each joint; `None`: the joints' effort limit.
    pub torque_peak: Option<Vec<f64>>,
    /// Treatment of a torque beyond its peak.
    pub torque_saturation: TorqueSaturation,
    /// Largest rate of every joint's torque at any time [N m/s; N/s]; `None`: no limit.
    pub torque_rate: Option<f64>,
    /// Longest start-up time of a process [ms].
    pub ready_timeout_ms: u32,
    /// Heartbeat age at which a process counts as lost [ms].
    pub heartbeat_timeout_ms: u32,
    /// Time that a run goes on without a supervisor [ms].
    pub grace_ms: u32,
    /// Longest time without a tick while every process is alive [ms].
    pub stall_timeout_ms: u32,
    /// Longest time of a process without a tick while other processes run ticks [ms].
    pub tick_timeout_ms: u32,
    /// Whether a second controller is ready to take over.
    pub standby: bool,
    /// Restarts of one process that the window allows; 0: none.
    pub restart_budget: u32,
    /// Window in which restarts count [ms].
    pub restart_window_ms: u32,
    /// Delay of the second restart within a window [ms]. The first restart is immediate; each further one waits twice
    /// as long, at most 1 s.
    pub restart_backoff_ms: u32,
    /// Largest rate of a joint's torque while it ramps in after a brake [N m/s; N/s].
    pub ramp_rate: f64,
    /// Step of a joint's torque between two ticks above which the gate reports an event [N m; N].
    pub discontinuity: f64,
    /// Lead of the plant over the recorder in lockstep [ticks].
    pub credit_ticks: u32,
}

/// Priorities (SCHED_FIFO, strictly falling from plant to planner) and cores (`None`: by `placement`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RealtimeSettings {
    /// Plant.
    pub priority_plant: u32,
    /// Gate.
    pub priority_gate: u32,
    /// Controller.
    pub priority_controller: u32,
    /// Planner.
    pub priority_planner: u32,
    /// Placement of threads without a core.
    pub placement: Placement,
    /// Busy-poll window before a state is due, of controller and gate [us]; 0: they sleep until it comes.
    pub busy_poll_lead_us: u32,
    /// Plant.
    pub core_plant: Option<u32>,
    /// Gate.
    pub core_gate: Option<u32>,
    /// Controller.
    pub core_controller: Option<u32>,
    /// Standby controller.
    pub core_standby: Option<u32>,
    /// Planner.
    pub core_planner: Option<u32>,
}

/// The log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecorderSettings {
    /// Interval between flushes of the file [ms].
    pub flush_ms: u32,
    /// Rate of the viewer frames [Hz].
    pub viewer_rate_hz: f64,
    /// Size of a chunk before compression [KiB].
    pub chunk_kib: u32,
    /// Size at which the log goes on in a new part [MB]; `None`: it is one file.
    pub part_mb: Option<u32>,
    /// Size of all parts above which the oldest but the first are removed [MB]; `None`: all stay.
    pub keep_mb: Option<u32>,
    /// Free space of the disk below which the log ends [MB].
    pub min_free_mb: u32,
    /// What follows when the log can no longer be written.
    pub on_failure: OnFailure,
}

/// External processes, program first; `None`: the built-in process.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExternalProcesses {
    /// Replaces the simulated plant.
    pub plant: Option<Vec<String>>,
    /// Replaces the planner.
    pub planner: Option<Vec<String>>,
    /// Replaces the controllers.
    pub controller: Option<Vec<String>>,
}
