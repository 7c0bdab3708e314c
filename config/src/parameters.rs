//! Parameters of controller and planner, and changes of them.

use crate::policy::{ResetPolicy, Saturation, Search};
use crate::settings::MAX_JOINTS;

/// Parameters that the operator may change. SI units, per axis of the world frame.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct ParameterSettings {
    /// Target x_t [m]; `None`: the position of the foot at the start.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target_position: Option<[f64; 3]>,
    /// Desired force F_d [N].
    pub desired_force: [f64; 3],
    /// Stiffness K0 [N/m].
    pub stiffness: [f64; 3],
    /// Largest force F_max [N]. A value below 0.95 K0 x_b is valid: the law bounds the force anyway.
    pub max_force: [f64; 3],
    /// Position bound x_b [m].
    pub position_bound: [f64; 3],
    /// Treatment of the searched offset at rest.
    pub reset_policy: ResetPolicy,
    /// Saturation of the force profile.
    pub saturation: Saturation,
    /// Step of the search.
    pub search: Search,
    /// Share of the force error removed in 1 ms.
    pub taper: f64,
    /// Sigma as the scale of the step.
    pub search_scale: f64,
    /// Sigma as the force threshold [N].
    pub force_resolution: f64,
    /// Whether g(q) is added.
    pub gravity_compensation: bool,
    /// Whether the searched offset stops at F_max, and follows a new K0, F_max or x_b so that the force stays.
    pub offset_anti_windup: bool,
    /// Whether a convergence that came to rest restarts from there.
    pub stall_release: bool,
    /// Whether in contact dx follows the reference, and a change of gains leaves the force between its value and F_d.
    pub force_hold: bool,
    /// Whether the force is continuous where the attractor enters divergence again.
    pub continuous_reentry: bool,
    /// Damping over the square root of K0 [kg^1/2].
    pub damping: f64,
    /// Time by which the posture of J^T is predicted [s].
    pub posture_lead: f64,
    /// Desired mean speed [m/s].
    pub mean_speed: f64,
    /// Largest acceleration a_max [m/s^2].
    pub max_acceleration: f64,
    /// The axes of rotation; `None` in a position task.
    #[serde(flatten)]
    pub rotation: Option<RotationSettings>,
    /// The law in joint space, which no operator changes.
    #[serde(skip)]
    pub joint_space: JointSpaceSettings,
}

/// Parameters of a pose task's axes of rotation. Axes of the world frame, through the tip.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct RotationSettings {
    /// Desired orientation: roll, pitch, yaw [rad]; `None`: that of the tip at the start.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target_orientation: Option<[f64; 3]>,
    /// Desired moment [N m].
    pub desired_moment: [f64; 3],
    /// K_R [N m/rad].
    pub rotation_stiffness: [f64; 3],
    /// T_max [N m].
    pub max_moment: [f64; 3],
    /// x_b,R [rad].
    pub rotation_bound: [f64; 3],
    /// Damping over the square root of K_R [kg^1/2 m].
    pub rotation_damping: f64,
    /// Sigma as the moment threshold [N m].
    pub moment_resolution: f64,
    /// Desired mean speed of a turn [rad/s].
    pub mean_turn_speed: f64,
    /// Largest angular acceleration of the reference [rad/s^2].
    pub max_turn_acceleration: f64,
}

/// The law in joint space: posture in the null space, damping, and springs at the limits.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct JointSpaceSettings {
    /// Desired posture q_n [rad; m], base to tip.
    pub posture: [f64; MAX_JOINTS],
    /// Joints that count in it.
    pub joints: u32,
    /// K_n [N m/rad].
    pub stiffness: f64,
    /// D_n [N m s/rad].
    pub damping: f64,
    /// Damping of every joint [N m s/rad].
    pub joint_damping: f64,
    /// Distance from a joint's limit at which its spring begins [rad].
    pub limit_margin: f64,
    /// Stiffness of the limit springs [N m/rad].
    pub limit_stiffness: f64,
}

impl RotationSettings {
    /// Returns these parameters after a change.
    fn with(self, change: &OperatorChange) -> Self {
        Self {
            target_orientation: change.target_orientation.or(self.target_orientation),
            desired_moment: change.desired_moment.unwrap_or(self.desired_moment),
            rotation_stiffness: change.rotation_stiffness.unwrap_or(self.rotation_stiffness),
            max_moment: change.max_moment.unwrap_or(self.max_moment),
            rotation_bound: change.rotation_bound.unwrap_or(self.rotation_bound),
            rotation_damping: change.rotation_damping.unwrap_or(self.rotation_damping),
            moment_resolution: change.moment_resolution.unwrap_or(self.moment_resolution),
            mean_turn_speed: change.mean_turn_speed.unwrap_or(self.mean_turn_speed),
            max_turn_acceleration: change.max_turn_acceleration.unwrap_or(self.max_turn_acceleration),
        }
    }
}

/// A change by the operator at a tick; `None` keeps the value. Units as in [`ParameterSettings`].
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Deserialize, serde::Serialize)]
pub struct OperatorChange {
    /// First tick with the new values.
    pub at_tick: i64,
    /// Target x_t [m].
    pub target_position: Option<[f64; 3]>,
    /// Desired force F_d [N].
    pub desired_force: Option<[f64; 3]>,
    /// Stiffness K0 [N/m].
    pub stiffness: Option<[f64; 3]>,
    /// Largest force F_max [N].
    pub max_force: Option<[f64; 3]>,
    /// Position bound x_b [m].
    pub position_bound: Option<[f64; 3]>,
    /// Treatment of the searched offset at rest.
    pub reset_policy: Option<ResetPolicy>,
    /// Saturation of the force profile.
    pub saturation: Option<Saturation>,
    /// Step of the search.
    pub search: Option<Search>,
    /// Share of the force error removed in 1 ms.
    pub taper: Option<f64>,
    /// Sigma as the scale of the step.
    pub search_scale: Option<f64>,
    /// Sigma as the force threshold [N].
    pub force_resolution: Option<f64>,
    /// Whether g(q) is added.
    pub gravity_compensation: Option<bool>,
    /// Whether the searched offset stops at F_max, and follows a new K0, F_max or x_b so that the force stays.
    pub offset_anti_windup: Option<bool>,
    /// Whether a convergence that came to rest restarts from there.
    pub stall_release: Option<bool>,
    /// Whether in contact dx follows the reference, and a change of gains leaves the force between its value and F_d.
    pub force_hold: Option<bool>,
    /// Whether the force is continuous where the attractor enters divergence again.
    pub continuous_reentry: Option<bool>,
    /// Damping over the square root of K0 [kg^1/2].
    pub damping: Option<f64>,
    /// Time by which the posture of J^T is predicted [s].
    pub posture_lead: Option<f64>,
    /// Desired mean speed [m/s].
    pub mean_speed: Option<f64>,
    /// Largest acceleration a_max [m/s^2].
    pub max_acceleration: Option<f64>,
    /// Desired orientation of the tip: roll, pitch, yaw [rad].
    pub target_orientation: Option<[f64; 3]>,
    /// Desired moment [N m].
    pub desired_moment: Option<[f64; 3]>,
    /// K_R [N m/rad].
    pub rotation_stiffness: Option<[f64; 3]>,
    /// T_max [N m].
    pub max_moment: Option<[f64; 3]>,
    /// x_b,R [rad].
    pub rotation_bound: Option<[f64; 3]>,
    /// Damping over the square root of K_R [kg^1/2 m].
    pub rotation_damping: Option<f64>,
    /// Sigma as the moment threshold [N m].
    pub moment_resolution: Option<f64>,
    /// Desired mean speed of a turn [rad/s].
    pub mean_turn_speed: Option<f64>,
    /// Largest angular acceleration of the reference [rad/s^2].
    pub max_turn_acceleration: Option<f64>,
}

impl OperatorChange {
    /// Name of a parameter of the rotation that this changes, as in an operator's entry; `None` if it changes none.
    #[must_use]
    pub fn rotation_key(&self) -> Option<&'static str> {
        [
            (self.target_orientation.is_some(), "target_orientation_rpy_rad"),
            (self.desired_moment.is_some(), "desired_moment_n_m"),
            (self.rotation_stiffness.is_some(), "rotation_stiffness_n_m_per_rad"),
            (self.max_moment.is_some(), "max_moment_n_m"),
            (self.rotation_bound.is_some(), "rotation_bound_rad"),
            (self.rotation_damping.is_some(), "rotation_damping_sqrt_kg_m"),
            (self.moment_resolution.is_some(), "moment_resolution_n_m"),
            (self.mean_turn_speed.is_some(), "mean_turn_speed_rad_per_s"),
            (self.max_turn_acceleration.is_some(), "max_turn_acceleration_rad_per_s2"),
        ]
        .into_iter()
        .find_map(|(given, key)| given.then_some(key))
    }
}

impl ParameterSettings {
    /// Returns these parameters after a change.
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
            force_hold: change.force_hold.unwrap_or(self.force_hold),
            continuous_reentry: change.continuous_reentry.unwrap_or(self.continuous_reentry),
            damping: change.damping.unwrap_or(self.damping),
            posture_lead: change.posture_lead.unwrap_or(self.posture_lead),
            mean_speed: change.mean_speed.unwrap_or(self.mean_speed),
            max_acceleration: change.max_acceleration.unwrap_or(self.max_acceleration),
            rotation: self.rotation.map(|rotation| rotation.with(change)),
            joint_space: self.joint_space,
        }
    }
}
