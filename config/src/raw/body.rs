//! Robot, world and plant as written.

use super::PerJoint;
use crate::policy::{EngineKind, OnLoss, ShapeKind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The robot, its place in the world, and its posture at the start.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawRobot {
    /// Robot description: the path of a URDF file relative to the scenario's file, or the name of an embedded one, such as
    /// "leg.urdf".
    pub(crate) urdf: String,

    /// Link that is fixed to the world.
    pub(crate) base_link: String,

    /// Link whose frame is the foot; the joints between the base and it are the robot.
    pub(crate) tip_link: String,

    /// Position of the base link in the world frame [m], each in [-100, 100]. Raising z lifts the whole robot.
    #[serde(default)]
    pub(crate) base_position_m: [f64; 3],

    /// Orientation of the base link: roll, pitch, yaw as in URDF [rad], each in [-10, 10].
    #[serde(default)]
    pub(crate) base_orientation_rpy_rad: [f64; 3],

    /// Joint positions at the start, base to tip [rad; m for a prismatic joint]: 1 to 16 numbers in [-100, 100].
    pub(crate) start_position_rad: Vec<f64>,

    /// Viscous damping of the joints [N m s/rad; N s/m for a prismatic joint], in [0, 1e4]: a number for all, a list, or a
    /// table by joint name, here and below. Default: the description's. Raising it resists free motion and damps oscillation
    /// faster.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) joint_damping_n_m_s_per_rad: Option<PerJoint>,

    /// Largest torque of the joints [N m; N for a prismatic joint], in (0, 1e5]. Default: the description's. Raising it lets the
    /// drive follow larger requests.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) effort_limit_n_m: Option<PerJoint>,

    /// Largest speed of the joints [rad/s; m/s for a prismatic joint], in (0, 1e4]. Default: the description's. It is watched, not
    /// enforced: a joint beyond it is a condition of the task.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) velocity_limit_rad_per_s: Option<PerJoint>,

    /// Coulomb friction of the joints [N m; N for a prismatic joint], in [0, 1e4]. Default: the description's. Raising it holds
    /// joints against small torques, and leaves errors of that size.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) joint_friction_n_m: Option<PerJoint>,

    /// Inertia of the rotors, seen at the joints [kg m^2; kg for a prismatic joint], in [0, 1e3]: inertia of the motor times the
    /// square of its gear ratio. URDF has none, so the default is 0; real arms have 0.1 and more. Raising it makes the robot
    /// slower, and bears more stiffness.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) armature_kg_m2: Option<PerJoint>,

    /// A foot in place of whatever shapes the tip link has. Needed where the tip has none, or a mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawFoot")]
    pub(crate) foot: Option<RawFoot>,
}

/// Foot: one sphere, several, or a box. It has either `radius_m` or `size_m`.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawFoot {
    /// Radius of a sphere, or of each of `centers_m` [m], in [1e-3, 1].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) radius_m: Option<f64>,

    /// Edges of a box along x, y, z of the tip frame [m], each in [1e-3, 1]. Flat on a plane it rests on four corners, each with
    /// the whole stiffness and damping of the surface.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) size_m: Option<[f64; 3]>,

    /// Centre of the sphere or box in the tip frame [m], each in [-10, 10].
    #[serde(default)]
    pub(crate) offset_m: [f64; 3],

    /// Centres of several spheres, from `offset_m` on [m], each in [-1, 1]; 1 to 8 of them. A flat foot is four at its corners.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) centers_m: Option<Vec<[f64; 3]>>,
}

/// Surroundings of the robot.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RawWorld {
    /// Gravity in the world frame, z up [m/s^2]; its length at most 100. A longer vector makes all bodies heavier.
    pub(crate) gravity_m_per_s2: [f64; 3],

    /// A level, infinite floor. Without this table there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawFloor")]
    pub(crate) floor: Option<RawFloor>,

    /// Free bodies, at most 4.
    #[serde(rename = "object", skip_serializing_if = "Vec::is_empty")]
    pub(crate) objects: Vec<RawObject>,
}

impl Default for RawWorld {
    fn default() -> Self {
        Self { gravity_m_per_s2: [0.0, 0.0, -9.81], floor: None, objects: Vec::new() }
    }
}

/// A level floor and its contact law: normal force s(d) (k d + b d') at depth d, friction against the slip.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RawFloor {
    /// Height z of the floor [m], in [-100, 100].
    pub(crate) height_m: f64,

    /// Contact stiffness k [N/m], in (0, 1e9]. Raising it makes contacts shallower and impacts harder.
    pub(crate) stiffness_n_per_m: f64,

    /// Contact damping b [N s/m], in [0, 1e7]. Raising it makes bodies rebound less.
    pub(crate) damping_n_s_per_m: f64,

    /// Transition width w, depth over which stiffness and damping fade in [m], in (0, 0.1]. Raising it softens the touch.
    pub(crate) transition_width_m: f64,

    /// Static friction mu_s, largest ratio of friction to normal force, in [0, 10]. Raising it holds more side force.
    pub(crate) friction_static: f64,

    /// Dynamic friction mu_d, the ratio while sliding, in [0, 10], at most mu_s. Raising it brakes sliding harder.
    pub(crate) friction_dynamic: f64,

    /// Critical speed v_c, slip at which friction reaches mu_s [m/s], in (0, 1]. Raising it makes loaded contacts creep faster.
    pub(crate) critical_speed_m_per_s: f64,
}

impl Default for RawFloor {
    fn default() -> Self {
        Self {
            height_m: 0.0,
            stiffness_n_per_m: 1e6,
            damping_n_s_per_m: 1e4,
            transition_width_m: 1e-3,
            friction_static: 0.0,
            friction_dynamic: 0.0,
            critical_speed_m_per_s: 1e-3,
        }
    }
}

/// A free body: a box or a ball of uniform density. A contact has the stiffness, damping and transition width of the softer
/// surface, and the friction of the more slippery one. The robot's links have the surface of the body they touch.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawObject {
    /// Name in messages and in the log; different from every other object and link, and from the floor.
    pub(crate) name: String,

    /// Shape: "box" or "ball".
    pub(crate) shape: ShapeKind,

    /// Edges of a box along its x, y and z [m], each in [1e-3, 10].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "[f64; 3]")]
    pub(crate) size_m: Option<[f64; 3]>,

    /// Radius of a ball [m], in [1e-3, 10].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64")]
    pub(crate) radius_m: Option<f64>,

    /// Mass [kg], in [1e-3, 1e4]. Raising it makes the object harder to push and to tip.
    pub(crate) mass_kg: f64,

    /// Position of the centre at the start in the world frame [m], each in [-100, 100].
    pub(crate) position_m: [f64; 3],

    /// Orientation at the start: roll, pitch, yaw [rad], each in [-10, 10].
    #[serde(default)]
    pub(crate) orientation_rpy_rad: [f64; 3],

    /// Contact stiffness k [N/m], in (0, 1e9]. Raising it makes contacts shallower and impacts harder.
    #[serde(default = "stiffness")]
    pub(crate) stiffness_n_per_m: f64,

    /// Contact damping b [N s/m], in [0, 1e7]. Raising it makes bodies rebound less.
    #[serde(default = "damping")]
    pub(crate) damping_n_s_per_m: f64,

    /// Transition width w, depth over which stiffness and damping fade in [m], in (0, 0.1]. Raising it softens the touch.
    #[serde(default = "transition_width")]
    pub(crate) transition_width_m: f64,

    /// Static friction mu_s, largest ratio of friction to normal force, in [0, 10]. Raising it holds more side force.
    #[serde(default = "friction_static")]
    pub(crate) friction_static: f64,

    /// Dynamic friction mu_d, the ratio while sliding, in [0, 10], at most mu_s. Raising it brakes sliding harder.
    #[serde(default = "friction_dynamic")]
    pub(crate) friction_dynamic: f64,

    /// Critical speed v_c, slip at which friction reaches mu_s [m/s], in (0, 1]. Raising it makes loaded contacts creep faster.
    #[serde(default = "critical_speed")]
    pub(crate) critical_speed_m_per_s: f64,
}

// Defaults: the paper's rigid bodies with friction.
fn stiffness() -> f64 {
    1e6
}
fn damping() -> f64 {
    1e4
}
fn transition_width() -> f64 {
    1e-3
}
fn friction_static() -> f64 {
    0.5
}
fn friction_dynamic() -> f64 {
    0.3
}
fn critical_speed() -> f64 {
    1e-3
}

/// The simulated plant: integration, and the drive's reaction to missing commands.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RawPlant {
    /// Longest integration step in contact [us], an integer in [1, 20]. Raising it saves time and lowers impact peaks.
    pub(crate) contact_substep_us: u32,

    /// Longest integration step in free flight [us], an integer in [1, 200]. Raising it saves time and loses accuracy.
    pub(crate) flight_substep_us: u32,

    /// Physics engine: "hapfic", or "rapier", which needs `softness`.
    pub(crate) engine: EngineKind,

    /// With `engine = "rapier"`: softness of all contacts, in place of stiffness, damping, transition width and critical speed
    /// of the surfaces; their friction is the dynamic one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) softness: Option<RawSoftness>,

    /// With `engine = "rapier"`: longest integration step [us], an integer in [20, 1000]. Raising it saves time and loses
    /// accuracy; friction holds up to 500.
    pub(crate) rapier_substep_us: u32,

    /// Ticks without a command after which the drive brakes by itself, an integer in [1, 100]. Raising it tolerates longer
    /// gaps, with an old torque.
    pub(crate) command_timeout_ticks: u32,

    /// Damping of the joints while the drive brakes [N m s/rad], in [0, 1e4]. Raising it makes the robot sink more slowly.
    pub(crate) brake_damping_n_m_s_per_rad: f64,

    /// Noise of the force sensor [N]: standard deviation on each axis, in [0, 100], new at every tick and repeatable by `seed`.
    pub(crate) force_noise_n: f64,

    /// Reaction to the loss of the plant: "fail" ends the run, "restart" restarts the plant from its last state.
    pub(crate) on_loss: OnLoss,
}

/// Softness of a contact: of a spring and damper between two bodies of their effective mass.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawSoftness {
    /// Natural frequency [Hz], in (0, 1000]. Raising it makes contacts harder.
    pub(crate) frequency_hz: f64,
    /// Damping ratio, in (0, 100]. Raising it makes impacts softer and lets contacts sink in.
    pub(crate) damping_ratio: f64,
}

impl Default for RawPlant {
    fn default() -> Self {
        Self {
            contact_substep_us: 20,
            flight_substep_us: 100,
            engine: EngineKind::default(),
            softness: None,
            rapier_substep_us: 250,
            command_timeout_ticks: 3,
            brake_damping_n_m_s_per_rad: 2.0,
            force_noise_n: 0.0,
            on_loss: OnLoss::Fail,
        }
    }
}
