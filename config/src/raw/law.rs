//! Controller, planner and operator as written.

use super::PerJoint;
use crate::policy::{Fidelity, ResetPolicy, Saturation, Search, Task};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Parameters of the controller at the start; the operator may change them later. Vectors are per axis of the world frame.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RawController {
    /// Stiffness K0 near the reference [N/m], each in (0, 1e6]. Raising it tracks the reference more closely.
    pub(crate) stiffness_n_per_m: [f64; 3],

    /// Largest force F_max [N], each in (0, 1e5]. Raising it lets the robot push harder against an obstacle.
    pub(crate) max_force_n: [f64; 3],

    /// Position bound x_b: error at which the force saturates, and bound of the searched offset [m], each in (0, 1]. Raising it
    /// lets the search reach further and the force grow over a longer distance.
    pub(crate) position_bound_m: [f64; 3],

    /// Step of the haptic search.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = "adaptive"))]
    pub(crate) search: Option<Search>,

    /// Treatment of the searched offset when the force is matched or F_d is zero.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = "contact_loss"))]
    pub(crate) reset_policy: Option<ResetPolicy>,

    /// Saturation of the force profile.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = "softening"))]
    pub(crate) saturation: Option<Saturation>,

    /// Stops the searched offset while F_max limits the force (conditional integration). After a change of K0, F_max or x_b it
    /// recomputes the offset so that the contact force stays. Without it the offset winds up at F_max.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = true))]
    pub(crate) offset_anti_windup: Option<bool>,

    /// Restarts the convergence from the position where the robot came to rest without contact. Without it a strongly damped
    /// robot stays near half of its travel.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = true))]
    pub(crate) stall_release: Option<bool>,

    /// In contact under a desired force: dx follows the reference, and a change of K0, F_max or x_b leaves the force between
    /// its value and F_d. After a loss of contact dx returns at 0.1 m/s. Without it such changes step the force.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = true))]
    pub(crate) force_hold: Option<bool>,

    /// Where the robot turns back before its reference, the force rises from its value to the profile instead of jumping.
    /// Without it a target out of reach makes the robot cycle.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = true))]
    pub(crate) continuous_reentry: Option<bool>,

    /// Damping of each axis over the square root of its stiffness [kg^(1/2)], in [0, 100]: the force on the error rate is this
    /// times sqrt(K0), within F_max. Raising it damps contacts with stiff walls; about sqrt(m) is too much for one tick of dead
    /// time, with m the smallest effective mass at the tip.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = 0.5))]
    pub(crate) damping_sqrt_kg: Option<f64>,

    /// Time by which J^T is ahead of the measured posture [s], in [0, 0.02]: q + q' times this. The torque acts from one to two
    /// ticks after its state, so 1.5 ms is right for this stack. Without it a stretched leg that pulls on swings for ever.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = 0.0015))]
    pub(crate) posture_lead_s: Option<f64>,

    /// Preset: "paper" sets search, reset_policy and saturation as the paper prints them, and switches offset_anti_windup,
    /// stall_release, force_hold, continuous_reentry, damping and posture_lead off. It excludes these keys.
    pub(crate) fidelity: Fidelity,

    /// Share of the force error that the search removes in 1 ms, in (0, 1]: with search = "tapered" always, with "adaptive" at
    /// most. Raising it settles faster; 0.8 limit-cycles on a stiff wall.
    pub(crate) taper: f64,

    /// Sigma as the scale of the search step (Algorithm 1): a step is this times |F_d| / K0, in (0, 1]. Raising it searches
    /// faster and leaves a larger limit cycle with search = "sign".
    pub(crate) search_scale: f64,

    /// Sigma as the force threshold (Algorithm 1) [N], in (0, 100]: a smaller force is no contact, a smaller error a match.
    /// Raising it ends the search earlier.
    pub(crate) force_resolution_n: f64,

    /// Adds the torque that holds the robot against gravity. The paper has none. Default: on above three joints, since the
    /// weight of an arm turns its redundant joints, which no task axis holds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) gravity_compensation: Option<bool>,

    /// What the law controls at the tip.
    pub(crate) task: Task,

    /// Stiffness K_R of a pose task near the desired orientation [N m/rad], each in (0, 1e4]. Default 30. Raising it holds the
    /// orientation more closely; `hapfic calibrate` prints what a robot bears.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) rotation_stiffness_n_m_per_rad: Option<[f64; 3]>,

    /// Largest moment T_max [N m], each in (0, 1e4]. Default 10. Raising it lets the tool turn harder against an obstacle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) max_moment_n_m: Option<[f64; 3]>,

    /// Bound x_b,R: orientation error at which the moment saturates [rad], each in (0, 1.5]. Default 0.3. Raising it lets the
    /// moment grow over a larger angle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) rotation_bound_rad: Option<[f64; 3]>,

    /// Damping of each axis of rotation over the square root of K_R [kg^(1/2) m], in [0, 10]. Default 0.05. Raising it damps the
    /// tool; too much for one tick of dead time is about sqrt(I), with I the smallest effective inertia at the tip.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) rotation_damping_sqrt_kg_m: Option<f64>,

    /// Sigma as the moment threshold of a desired moment [N m], in (0, 10]. Default 0.01. As `force_resolution_n`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) moment_resolution_n_m: Option<f64>,

    /// Desired posture in the null space of the task [rad; m for a prismatic joint]: a number for all, or a list. Default: the
    /// start posture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) posture_rad: Option<PerJoint>,

    /// Stiffness K_n towards that posture [N m/rad], in [0, 1e4], at the joint with the largest inertia; the others have their
    /// share of it. Default: 10 above three joints, else 0. Raising it returns to the posture faster.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) posture_stiffness_n_m_per_rad: Option<f64>,

    /// Damping D_n in the null space [N m s/rad], in [0, 1e3], shared as K_n. Default: 4 above three joints, else 0. Raising it
    /// stops motions of the elbow faster.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) posture_damping_n_m_s_per_rad: Option<f64>,

    /// Damping of every joint by the controller [N m s/rad], in [0, 1e3]. Unlike D_n it needs no trusted mass matrix, and slows
    /// the task, too.
    pub(crate) joint_damping_n_m_s_per_rad: f64,

    /// Distance from a joint's limit at which a spring pushes it back [rad], in [0, 1]. Raising it keeps further away.
    pub(crate) limit_margin_rad: f64,

    /// Stiffness of these springs [N m/rad], in [0, 1e4]. Default: 100 above three joints, else 0. Raising it lets a joint come
    /// closer to its limit only under larger loads.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) limit_stiffness_n_m_per_rad: Option<f64>,
}

impl Default for RawController {
    fn default() -> Self {
        Self {
            stiffness_n_per_m: [6000.0, 6000.0, 12_000.0],
            max_force_n: [150.0, 150.0, 300.0],
            position_bound_m: [0.025; 3],
            search: None,
            reset_policy: None,
            saturation: None,
            offset_anti_windup: None,
            stall_release: None,
            force_hold: None,
            continuous_reentry: None,
            damping_sqrt_kg: None,
            posture_lead_s: None,
            fidelity: Fidelity::Hapfic,
            taper: 0.4,
            search_scale: 0.01,
            force_resolution_n: 0.01,
            gravity_compensation: None,
            task: Task::Position,
            rotation_stiffness_n_m_per_rad: None,
            max_moment_n_m: None,
            rotation_bound_rad: None,
            rotation_damping_sqrt_kg_m: None,
            moment_resolution_n_m: None,
            posture_rad: None,
            posture_stiffness_n_m_per_rad: None,
            posture_damping_n_m_s_per_rad: None,
            joint_damping_n_m_s_per_rad: 0.0,
            limit_margin_rad: 0.1,
            limit_stiffness_n_m_per_rad: None,
        }
    }
}

/// Parameters of the planner at the start; the operator may change them later.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RawPlanner {
    /// Desired mean speed of a motion [m/s], in (0, 10]; the peak is 1.596 times that. Raising it shortens the motion.
    pub(crate) mean_speed_m_per_s: f64,

    /// Largest acceleration a_max of the reference per axis [m/s^2], in (0, 1000]. Raising it starts and brakes harder.
    pub(crate) max_acceleration_m_per_s2: f64,

    /// Desired mean speed of a turn in a pose task [rad/s], in (0, 30]. Default 0.5. Raising it shortens the turn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) mean_turn_speed_rad_per_s: Option<f64>,

    /// Largest angular acceleration of the reference per axis in a pose task [rad/s^2], in (0, 3000]. Default 10. Raising it
    /// starts and brakes turns harder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) max_turn_acceleration_rad_per_s2: Option<f64>,
}

impl Default for RawPlanner {
    fn default() -> Self {
        Self {
            mean_speed_m_per_s: 0.2,
            max_acceleration_m_per_s2: 10.0,
            mean_turn_speed_rad_per_s: None,
            max_turn_acceleration_rad_per_s2: None,
        }
    }
}

/// A change by the operator at a given time. Keys that are not given keep their values; at least one must be given.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawOperator {
    /// Time since the start [s], in [0, 86400]; at least 5 ms after the previous entry. An entry at 0 sets the start values.
    /// An entry at or after the run's end has no effect, so that `--duration` can shorten a run.
    pub(crate) at_s: f64,

    /// Target x_t of the foot in the world frame [m], at most 100 from the origin.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) target_position_m: Option<[f64; 3]>,

    /// Desired force F_d: reaction of the environment on the foot [N], its length at most 1e4. Pressing down with 50 N is
    /// [0, 0, 50]. Raising it presses harder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) desired_force_n: Option<[f64; 3]>,

    /// K0 [N/m], each in (0, 1e6]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) stiffness_n_per_m: Option<[f64; 3]>,

    /// F_max [N], each in (0, 1e5]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) max_force_n: Option<[f64; 3]>,

    /// x_b [m], each in (0, 1]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) position_bound_m: Option<[f64; 3]>,

    /// As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) reset_policy: Option<ResetPolicy>,

    /// As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) saturation: Option<Saturation>,

    /// As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) search: Option<Search>,

    /// Share of the force error removed in 1 ms, in (0, 1]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) taper: Option<f64>,

    /// Scale of the search step, in (0, 1]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) search_scale: Option<f64>,

    /// Force threshold [N], in (0, 100]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) force_resolution_n: Option<f64>,

    /// As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) gravity_compensation: Option<bool>,

    /// As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) offset_anti_windup: Option<bool>,

    /// As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) stall_release: Option<bool>,

    /// As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) force_hold: Option<bool>,

    /// As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) continuous_reentry: Option<bool>,

    /// Damping over sqrt(K0) [kg^(1/2)], in [0, 100]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) damping_sqrt_kg: Option<f64>,

    /// Time by which J^T is ahead of the posture [s], in [0, 0.02]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) posture_lead_s: Option<f64>,

    /// Desired mean speed [m/s], in (0, 10]. As in `planner`; applies to the next target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) mean_speed_m_per_s: Option<f64>,

    /// a_max [m/s^2], in (0, 1000]. As in `planner`; applies to the next target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) max_acceleration_m_per_s2: Option<f64>,

    /// Desired orientation of the tip in a pose task: roll, pitch, yaw as in URDF [rad], each in [-10, 10].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) target_orientation_rpy_rad: Option<[f64; 3]>,

    /// Desired moment of the environment on the foot about the tip in a pose task [N m], its length at most 1e3. An axis with
    /// zero is held by its orientation alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) desired_moment_n_m: Option<[f64; 3]>,

    /// K_R [N m/rad], each in (0, 1e4]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) rotation_stiffness_n_m_per_rad: Option<[f64; 3]>,

    /// T_max [N m], each in (0, 1e4]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) max_moment_n_m: Option<[f64; 3]>,

    /// x_b,R [rad], each in (0, 1.5]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) rotation_bound_rad: Option<[f64; 3]>,

    /// Damping of rotation over sqrt(K_R) [kg^(1/2) m], in [0, 10]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) rotation_damping_sqrt_kg_m: Option<f64>,

    /// Moment threshold [N m], in (0, 10]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) moment_resolution_n_m: Option<f64>,

    /// Desired mean speed of a turn [rad/s], in (0, 30]. As in `planner`; applies to the next target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) mean_turn_speed_rad_per_s: Option<f64>,

    /// Largest angular acceleration [rad/s^2], in (0, 3000]. As in `planner`; applies to the next target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) max_turn_acceleration_rad_per_s2: Option<f64>,
}
