//! Robot, world and plant as written.

use super::PerJoint;
use crate::policy::{OnLoss, ShapeKind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The limb, its place in the world, and how it stands at the start.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawRobot {
    /// The robot description: a URDF file, its path relative to the scenario's file, or the name of an embedded one, such
    /// as "leg.urdf".
    pub(crate) urdf: String,

    /// Link of the description that is fixed to the world.
    pub(crate) base_link: String,

    /// Link whose frame is the foot; the joints between it and the base are the limb.
    pub(crate) tip_link: String,

    /// Where the base link stands, m, world frame, each in [-100, 100]. Raising z lifts the whole limb.
    #[serde(default)]
    pub(crate) base_position_m: [f64; 3],

    /// How the base link is turned: roll, pitch, yaw as in URDF, rad, each in [-10, 10].
    #[serde(default)]
    pub(crate) base_orientation_rpy_rad: [f64; 3],

    /// Joints at the start, base to tip: 1 to 8 numbers in [-100, 100], rad, or m for a prismatic joint.
    pub(crate) start_position_rad: Vec<f64>,

    /// Viscous damping of the joints, N m s/rad (N s/m for a prismatic joint), in [0, 1e4]: a number for all, or a list.
    /// Without it the description's. Raising it makes the limb sluggish: free motion is resisted, oscillation dies sooner.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) joint_damping_n_m_s_per_rad: Option<PerJoint>,

    /// Largest torque of the joints, N m (N for a prismatic joint), in (0, 1e5]: a number for all, or a list. Without it
    /// the description's. Raising it lets the drive follow larger requests.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) effort_limit_n_m: Option<PerJoint>,
}

/// What is around the limb.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RawWorld {
    /// Gravity, m/s^2, world frame with z up; its length at most 100. A longer vector makes everything heavier.
    pub(crate) gravity_m_per_s2: [f64; 3],

    /// A level floor without end. Without this table there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawFloor")]
    pub(crate) floor: Option<RawFloor>,

    /// What moves freely, at most 4 of them.
    #[serde(rename = "object", skip_serializing_if = "Vec::is_empty")]
    pub(crate) objects: Vec<RawObject>,
}

impl Default for RawWorld {
    fn default() -> Self {
        Self { gravity_m_per_s2: [0.0, 0.0, -9.81], floor: None, objects: Vec::new() }
    }
}

/// A level floor and its contact: normal force s(d) (k d + b d') at depth d, friction opposing the slip.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RawFloor {
    /// Its z, m, in [-100, 100].
    pub(crate) height_m: f64,

    /// k, N/m, in (0, 1e9]. Raising it makes contacts shallower and impacts harder.
    pub(crate) stiffness_n_per_m: f64,

    /// b, N s/m, in [0, 1e7]. Raising it takes the bounce out of impacts.
    pub(crate) damping_n_s_per_m: f64,

    /// w, depth over which stiffness and damping come in, m, in (0, 0.1]. Raising it makes the touch softer.
    pub(crate) transition_width_m: f64,

    /// mu_s, largest ratio of friction to normal force, in [0, 10]. Raising it lets more side force hold without slip.
    pub(crate) friction_static: f64,

    /// mu_d, the ratio while sliding, in [0, 10], at most mu_s. Raising it brakes sliding harder.
    pub(crate) friction_dynamic: f64,

    /// v_c, slip at which friction reaches mu_s, m/s, in (0, 1]. Raising it lets loaded contacts creep faster.
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

/// A body that moves freely: a box or a ball of even density. Where two surfaces meet, the softer one's stiffness, damping and
/// transition width count, and the friction of the more slippery one; the robot's links take over what they touch.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawObject {
    /// Its name in messages and in the log; unlike any other object, link or the floor.
    pub(crate) name: String,

    /// "box" or "ball".
    pub(crate) shape: ShapeKind,

    /// Edges of a box along its x, y and z, m, each in [1e-3, 10].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "[f64; 3]")]
    pub(crate) size_m: Option<[f64; 3]>,

    /// Radius of a ball, m, in [1e-3, 10].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64")]
    pub(crate) radius_m: Option<f64>,

    /// Its mass, kg, in [1e-3, 1e4]. Raising it makes it harder to push and to tip.
    pub(crate) mass_kg: f64,

    /// Where its centre is at the start, m, world frame, each in [-100, 100].
    pub(crate) position_m: [f64; 3],

    /// How it is turned at the start: roll, pitch, yaw, rad, each in [-10, 10].
    #[serde(default)]
    pub(crate) orientation_rpy_rad: [f64; 3],

    /// k, N/m, in (0, 1e9]. Raising it makes contacts shallower and impacts harder.
    #[serde(default = "stiffness")]
    pub(crate) stiffness_n_per_m: f64,

    /// b, N s/m, in [0, 1e7]. Raising it takes the bounce out of impacts.
    #[serde(default = "damping")]
    pub(crate) damping_n_s_per_m: f64,

    /// w, depth over which stiffness and damping come in, m, in (0, 0.1]. Raising it makes the touch softer.
    #[serde(default = "transition_width")]
    pub(crate) transition_width_m: f64,

    /// mu_s, largest ratio of friction to normal force, in [0, 10]. Raising it lets more side force hold without slip.
    #[serde(default = "friction_static")]
    pub(crate) friction_static: f64,

    /// mu_d, the ratio while sliding, in [0, 10], at most mu_s. Raising it brakes sliding harder.
    #[serde(default = "friction_dynamic")]
    pub(crate) friction_dynamic: f64,

    /// v_c, slip at which friction reaches mu_s, m/s, in (0, 1]. Raising it lets loaded contacts creep faster.
    #[serde(default = "critical_speed")]
    pub(crate) critical_speed_m_per_s: f64,
}

// The paper's rigid bodies with friction.
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

/// The simulated plant: integration, and what the drive does without commands.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RawPlant {
    /// Longest step of the integration in contact, us, an integer in [1, 20]. Raising it is faster and lowers impact peaks.
    pub(crate) contact_substep_us: u32,

    /// Longest step in free flight, us, an integer in [1, 200]. Raising it is faster and less exact.
    pub(crate) flight_substep_us: u32,

    /// Ticks without a command after which the drive brakes by itself, an integer in [1, 100]. Raising it rides out longer
    /// gaps under an old torque.
    pub(crate) command_timeout_ticks: u32,

    /// Damping of the joints while the drive brakes, N m s/rad, in [0, 1e4]. Raising it lets the limb sink more slowly.
    pub(crate) brake_damping_n_m_s_per_rad: f64,

    /// What becomes of a run whose plant is lost: "fail" ends it, "restart" starts the plant again from its last state.
    pub(crate) on_loss: OnLoss,
}

impl Default for RawPlant {
    fn default() -> Self {
        Self {
            contact_substep_us: 20,
            flight_substep_us: 100,
            command_timeout_ticks: 3,
            brake_damping_n_m_s_per_rad: 2.0,
            on_loss: OnLoss::Fail,
        }
    }
}
