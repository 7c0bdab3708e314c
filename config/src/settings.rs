//! A checked scenario.

use crate::fault::Fault;
use crate::policy::{Fidelity, OnLoss, Placement, ResetPolicy, Saturation, Search};

/// T, the period of the control loop, s.
pub const PERIOD_S: f64 = 0.001;

/// Most joints a robot may have.
pub const MAX_JOINTS: usize = 8;

/// Most objects a world may have.
pub const MAX_OBJECTS: usize = 4;

/// Fewest ticks between two entries of the operator: a change is announced this long ahead.
pub const MIN_SPACING_TICKS: i64 = 5;

/// A scenario after all checks: every number is finite and in its range, and all fit together.
///
/// Change a scenario by overrides, not by these fields: [`Settings::effective_toml`] tells what was loaded.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// One line that says what happens.
    pub title: String,
    /// What it shows.
    pub description: String,
    /// How long it runs, ticks of [`PERIOD_S`]; at least 1.
    pub duration_ticks: u64,
    /// Seed of every random draw.
    pub seed: u64,
    /// The limb.
    pub robot: Robot,
    /// What is around it.
    pub world: World,
    /// The simulated plant.
    pub plant: Plant,
    /// How close to print the controller is.
    pub fidelity: Fidelity,
    /// In force from the first tick on: controller, planner, and the operator's entry at 0 if there is one.
    pub initial: Parameters,
    /// What the operator changes later, in the order of time; all ticks are above 0.
    pub operator: Vec<OperatorChange>,
    /// Faults on purpose, drawn and in the order of time; all ticks are within the run.
    pub faults: Vec<Fault>,
    /// Gate and watchdog.
    pub supervisor: Supervisor,
    /// Priorities and cores.
    pub realtime: Realtime,
    /// The log.
    pub recorder: Recorder,
    /// Foreign commands.
    pub processes: Processes,
    pub(crate) effective: String,
}

/// The limb and how it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// Its description.
    pub urdf: Urdf,
    /// Link that is fixed to the world.
    pub base_link: String,
    /// Link whose frame is the foot.
    pub tip_link: String,
    /// Of the base link, m, world frame.
    pub base_position_m: [f64; 3],
    /// Of the base link: roll, pitch, yaw, rad.
    pub base_orientation_rpy_rad: [f64; 3],
    /// q at the start, base to tip, rad (m for prismatic joints); 1 to [`MAX_JOINTS`] numbers. Whether the description has
    /// as many joints is for the robot's model to say.
    pub start_position: Vec<f64>,
    /// N m s/rad (N s/m), one for each joint; none: the description's.
    pub joint_damping: Option<Vec<f64>>,
    /// N m (N), one for each joint; none: the description's.
    pub effort_limit: Option<Vec<f64>>,
}

/// A robot description, loaded.
#[derive(Clone, Debug, PartialEq)]
pub struct Urdf {
    /// Its file, or its name among the embedded ones: for messages.
    pub name: String,
    /// The XML.
    pub text: String,
}

/// What is around the limb.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    /// m/s^2, world frame.
    pub gravity_m_per_s2: [f64; 3],
    /// The floor, if there is one.
    pub floor: Option<Floor>,
    /// What moves freely, at most [`MAX_OBJECTS`].
    pub objects: Vec<Object>,
}

/// A level floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Floor {
    /// Its z, m.
    pub height_m: f64,
    /// How it feels.
    pub surface: Surface,
}

/// A body that moves freely.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Its name, unique among the objects.
    pub name: String,
    /// Form and size.
    pub shape: ObjectShape,
    /// kg, evenly spread over the shape.
    pub mass_kg: f64,
    /// Of its centre at the start, m, world frame.
    pub position_m: [f64; 3],
    /// At the start: roll, pitch, yaw, rad.
    pub orientation_rpy_rad: [f64; 3],
    /// How it feels.
    pub surface: Surface,
}

/// Form and size of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ObjectShape {
    /// A box with its edges along x, y and z, m.
    Box {
        /// Lengths of the edges, m.
        size_m: [f64; 3],
    },
    /// A ball.
    Ball {
        /// m.
        radius_m: f64,
    },
}

/// Contact law of a body's surface.
///
/// Where two surfaces meet, the softer one's k, b and w count, and mu_s, mu_d and v_c of the more slippery one; a robot's links
/// take over what they touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// k, N/m.
    pub stiffness_n_per_m: f64,
    /// b, N s/m.
    pub damping_n_s_per_m: f64,
    /// w, m.
    pub transition_width_m: f64,
    /// mu_s.
    pub friction_static: f64,
    /// mu_d, at most mu_s.
    pub friction_dynamic: f64,
    /// v_c, m/s.
    pub critical_speed_m_per_s: f64,
}

/// Integration and drive of the simulated plant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plant {
    /// Longest step in contact, us; need not divide the period.
    pub contact_substep_us: u32,
    /// Longest step in free flight, us; need not divide the period.
    pub flight_substep_us: u32,
    /// Ticks without a command after which the drive brakes.
    pub command_timeout_ticks: u32,
    /// Damping while braking, N m s/rad.
    pub brake_damping_n_m_s_per_rad: f64,
    /// What becomes of a run whose plant is lost.
    pub on_loss: OnLoss,
}

/// Everything the operator may change. SI units, per axis of the world frame.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Parameters {
    /// x_t, m; none: where the foot stands at the start.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target_position: Option<[f64; 3]>,
    /// F_d, N.
    pub desired_force: [f64; 3],
    /// K0, N/m.
    pub stiffness: [f64; 3],
    /// F_max, N. Below 0.95 K0 x_b is legal: the law bounds the force anyway.
    pub max_force: [f64; 3],
    /// x_b, m.
    pub position_bound: [f64; 3],
    /// What happens to the searched offset at rest.
    pub reset_policy: ResetPolicy,
    /// How the force profile saturates.
    pub saturation: Saturation,
    /// The step of the search.
    pub search: Search,
    /// Share of the force error worked off in 1 ms.
    pub taper: f64,
    /// sigma as the scale of the step.
    pub search_scale: f64,
    /// sigma as the force threshold, N.
    pub force_resolution: f64,
    /// Whether g(q) is added.
    pub gravity_compensation: bool,
    /// Whether the searched offset is kept from winding up at F_max, and refitted to a new K0, F_max or x_b so that the force stays.
    pub offset_anti_windup: bool,
    /// Whether a convergence that has come to a standstill starts anew from there.
    pub stall_release: bool,
    /// Wished mean speed, m/s.
    pub mean_speed: f64,
    /// a_max, m/s^2.
    pub max_acceleration: f64,
}

/// What the operator changes at a tick; none: stays as it is. Units as in [`Parameters`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OperatorChange {
    /// First tick at which it is in force.
    pub at_tick: i64,
    /// x_t, m.
    pub target_position: Option<[f64; 3]>,
    /// F_d, N.
    pub desired_force: Option<[f64; 3]>,
    /// K0, N/m.
    pub stiffness: Option<[f64; 3]>,
    /// F_max, N.
    pub max_force: Option<[f64; 3]>,
    /// x_b, m.
    pub position_bound: Option<[f64; 3]>,
    /// What happens to the searched offset at rest.
    pub reset_policy: Option<ResetPolicy>,
    /// How the force profile saturates.
    pub saturation: Option<Saturation>,
    /// The step of the search.
    pub search: Option<Search>,
    /// Share of the force error worked off in 1 ms.
    pub taper: Option<f64>,
    /// sigma as the scale of the step.
    pub search_scale: Option<f64>,
    /// sigma as the force threshold, N.
    pub force_resolution: Option<f64>,
    /// Whether g(q) is added.
    pub gravity_compensation: Option<bool>,
    /// Whether the searched offset is kept from winding up at F_max, and refitted to a new K0, F_max or x_b so that the force stays.
    pub offset_anti_windup: Option<bool>,
    /// Whether a convergence that has come to a standstill starts anew from there.
    pub stall_release: Option<bool>,
    /// Wished mean speed, m/s.
    pub mean_speed: Option<f64>,
    /// a_max, m/s^2.
    pub max_acceleration: Option<f64>,
}

impl Parameters {
    /// These parameters after a change.
    #[must_use]
    pub fn with(self, change: &OperatorChange) -> Self {
        Self {
            target_position: change.target_position.or(self.target_position),
            desired_force: change.desired_force.unwrap_or(self.desired_force),
            stiffness: change.stiffness.unwrap_or(self.stiffness),
            max_force: change.max_force.unwrap_or(self.max_force),
            position_bound: change.position_bound.unwrap_or(self.position_bound),
            reset_policy: change.reset_policy.unwrap_or(self.reset_policy),
            saturation: change.saturation.unwrap_or(self.saturation),
            search: change.search.unwrap_or(self.search),
            taper: change.taper.unwrap_or(self.taper),
            search_scale: change.search_scale.unwrap_or(self.search_scale),
            force_resolution: change.force_resolution.unwrap_or(self.force_resolution),
            gravity_compensation: change.gravity_compensation.unwrap_or(self.gravity_compensation),
            offset_anti_windup: change.offset_anti_windup.unwrap_or(self.offset_anti_windup),
            stall_release: change.stall_release.unwrap_or(self.stall_release),
            mean_speed: change.mean_speed.unwrap_or(self.mean_speed),
            max_acceleration: change.max_acceleration.unwrap_or(self.max_acceleration),
        }
    }
}

/// The torque gate and the watchdog.
#[derive(Clone, Debug, PartialEq)]
pub struct Supervisor {
    /// How long after the state the gate waits for a request, us.
    pub deadline_us: u32,
    /// Bandwidth of the torque filter, Hz; none: no filter.
    pub torque_bandwidth_hz: Option<f64>,
    /// Peak after the filter, N m (N), one for each joint; none: the joints' effort limit.
    pub torque_peak: Option<Vec<f64>>,
    /// How long a process may take to get ready, ms.
    pub ready_timeout_ms: u32,
    /// Age of the last sign of life at which a process counts as lost, ms.
    pub heartbeat_timeout_ms: u32,
    /// How long no tick may be done while all are alive, ms.
    pub stall_timeout_ms: u32,
    /// How long a process may be alive without doing a tick while others do, ms.
    pub tick_timeout_ms: u32,
    /// Whether a second controller is ready to take over.
    pub standby: bool,
    /// Restarts of one process that are allowed within the window; 0: none.
    pub restart_budget: u32,
    /// The window in which restarts count, ms.
    pub restart_window_ms: u32,
    /// How long the second restart within a window waits, ms; the first is at once, each further one waits twice as long, at
    /// most 1 s.
    pub restart_backoff_ms: u32,
    /// Most that a joint's torque may change per second while it comes back after a brake, N m/s (N/s).
    pub ramp_rate: f64,
    /// Step of a joint's torque from one tick to the next above which an event is written, N m (N).
    pub discontinuity: f64,
    /// How far the plant may be ahead of the recorder in lockstep, ticks.
    pub credit_ticks: u32,
}

/// Priorities (SCHED_FIFO, strictly falling from plant to planner) and cores (none: as `placement` says).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Realtime {
    /// Of the plant.
    pub priority_plant: u32,
    /// Of the gate.
    pub priority_gate: u32,
    /// Of the controller.
    pub priority_controller: u32,
    /// Of the planner.
    pub priority_planner: u32,
    /// Where threads without a core run.
    pub placement: Placement,
    /// How long before a state is due those who answer it are awake, us; 0: they sleep until it comes.
    pub busy_poll_lead_us: u32,
    /// Of the plant.
    pub core_plant: Option<u32>,
    /// Of the gate.
    pub core_gate: Option<u32>,
    /// Of the controller.
    pub core_controller: Option<u32>,
    /// Of the controller in reserve.
    pub core_standby: Option<u32>,
    /// Of the planner.
    pub core_planner: Option<u32>,
}

/// The log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recorder {
    /// How often the file is flushed, ms.
    pub flush_ms: u32,
    /// Scenes a second for a viewer, Hz.
    pub viewer_rate_hz: f64,
    /// Size of a chunk before compression, KiB.
    pub chunk_kib: u32,
}

/// Foreign commands, program first; none: the built-in process.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Processes {
    /// In place of the simulated plant.
    pub plant: Option<Vec<String>>,
    /// In place of the planner.
    pub planner: Option<Vec<String>>,
    /// In place of the controllers.
    pub controller: Option<Vec<String>>,
}
