//! Controller, planner and operator as written.

use crate::policy::{Fidelity, ResetPolicy, Saturation, Search};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The controller's parameters at the start; the operator may change them later. Vectors are per axis of the world frame.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RawController {
    /// K0, stiffness near the reference, N/m, each in (0, 1e6]. Raising it holds the reference tighter.
    pub(crate) stiffness_n_per_m: [f64; 3],

    /// F_max, largest force, N, each in (0, 1e5]. Raising it lets the limb push harder when it is held off.
    pub(crate) max_force_n: [f64; 3],

    /// x_b, error at which the force saturates and bound of the searched offset, m, each in (0, 1]. Raising it lets the
    /// search reach further and the force grow over a longer way.
    pub(crate) position_bound_m: [f64; 3],

    /// The step of the haptic search.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = "tapered"))]
    pub(crate) search: Option<Search>,

    /// What happens to the searched offset when the force is matched or none is wished.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = "contact_loss"))]
    pub(crate) reset_policy: Option<ResetPolicy>,

    /// How the force profile saturates.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = "continuous"))]
    pub(crate) saturation: Option<Saturation>,

    /// Keeps the searched offset from moving further while F_max holds the force, and refits it to a new K0, F_max or x_b, so that the
    /// contact force stays. Without it the offset winds up at F_max and has to be searched back.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = true))]
    pub(crate) offset_anti_windup: Option<bool>,

    /// Starts the convergence anew from where the limb has come to a standstill without contact. Without it a strongly damped
    /// limb stays near half of its way.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("default" = true))]
    pub(crate) stall_release: Option<bool>,

    /// "paper" sets search, reset_policy and saturation as the paper prints them, and switches offset_anti_windup and
    /// stall_release off; none of these may be given beside it.
    pub(crate) fidelity: Fidelity,

    /// Share of the force error that the tapered search works off in 1 ms, in (0, 1]. Raising it settles faster; 0.8
    /// limit-cycles on a stiff wall.
    pub(crate) taper: f64,

    /// sigma as the scale of the search step (Algorithm 1): a step is this times |F_d| / K0, in (0, 1]. Raising it searches
    /// faster and leaves a larger limit cycle with search = "sign".
    pub(crate) search_scale: f64,

    /// sigma as the force threshold (Algorithm 1), N, in (0, 100]: smaller forces are no contact, smaller errors a match.
    /// Raising it makes the search rest earlier.
    pub(crate) force_resolution_n: f64,

    /// Adds the torque that holds the limb against gravity. The paper has none.
    pub(crate) gravity_compensation: bool,
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
            fidelity: Fidelity::Hapfic,
            taper: 0.2,
            search_scale: 0.01,
            force_resolution_n: 0.01,
            gravity_compensation: false,
        }
    }
}

/// The planner's parameters at the start; the operator may change them later.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct RawPlanner {
    /// Wished mean speed of a motion, m/s, in (0, 10]; the peak is 1.596 times that. Raising it arrives sooner.
    pub(crate) mean_speed_m_per_s: f64,

    /// a_max, largest acceleration of the reference per axis, m/s^2, in (0, 1000]. Raising it starts and brakes harder.
    pub(crate) max_acceleration_m_per_s2: f64,
}

impl Default for RawPlanner {
    fn default() -> Self {
        Self { mean_speed_m_per_s: 0.2, max_acceleration_m_per_s2: 10.0 }
    }
}

/// What the operator changes at a moment; what is not named stays as it is. At least one thing must be named.
#[derive(Clone, Debug, Deserialize, JsonSchema, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawOperator {
    /// When, s since the start, in [0, 86400]; at least 5 ms after the entry before. At 0 it sets the start values; at or after
    /// the run's end it never happens, so that `--duration` can cut a run short.
    pub(crate) at_s: f64,

    /// x_t, where the foot shall go, m, world frame, at most 100 from the origin.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) target_position_m: Option<[f64; 3]>,

    /// F_d, wished reaction of the environment on the foot, N, its length at most 1e4: pressing down with 50 N is
    /// [0, 0, 50]. Raising it presses harder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) desired_force_n: Option<[f64; 3]>,

    /// K0, N/m, each in (0, 1e6]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) stiffness_n_per_m: Option<[f64; 3]>,

    /// F_max, N, each in (0, 1e5]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) max_force_n: Option<[f64; 3]>,

    /// x_b, m, each in (0, 1]. As in `controller`.
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

    /// Share of the force error worked off in 1 ms, in (0, 1]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) taper: Option<f64>,

    /// Scale of the search step, in (0, 1]. As in `controller`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) search_scale: Option<f64>,

    /// Force threshold, N, in (0, 100]. As in `controller`.
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

    /// m/s, in (0, 10]. As in `planner`; counts for the next target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) mean_speed_m_per_s: Option<f64>,

    /// m/s^2, in (0, 1000]. As in `planner`; counts for the next target.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) max_acceleration_m_per_s2: Option<f64>,
}
