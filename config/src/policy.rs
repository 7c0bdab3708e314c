//! Policies: settings whose value is a word.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Step of the haptic search (Algorithm 1).
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Search {
    /// Steps shrink with the force error, and the taper of each axis adapts: it falls while the force oscillates about F_d
    /// and grows otherwise. Settles on stiff, lightly damped walls and on soft ones.
    #[default]
    Adaptive,
    /// Steps shrink with the force error by a fixed taper: the search settles on well damped walls.
    Tapered,
    /// A full step every tick, as in the paper: a limit cycle of about one step remains.
    Sign,
}

/// Treatment of the searched offset dx when the force is matched or F_d is zero (Algorithm 1, `Reset`).
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ResetPolicy {
    /// dx returns to zero when F_d is zero, and is kept while the force is matched. A lost contact resets it under every
    /// policy.
    #[default]
    ContactLoss,
    /// dx returns to zero whenever the search is at rest (`Reset = true`): the force collapses when it is matched.
    AsPrinted,
    /// dx is kept also when F_d is zero (`Reset = false`).
    Never,
}

/// Saturation of the force profile (eq. 4).
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Saturation {
    /// Within the last 5 % of min(F_max, K0 x_b): F_c(e) / e never grows, so no error gives more than K0 x_b.
    #[default]
    Softening,
    /// S = 0.05 / (2 pi): within the last 5 % of x_b, as the paper's text states. Hardens if F_max exceeds K0 x_b.
    Continuous,
    /// S = 0.1353, the printed value: the force steps at 0.95 x_b.
    AsPrinted,
}

/// What the task-space law controls at the tip.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Task {
    /// The position: three axes of the world frame, and forces alone.
    #[default]
    Position,
    /// Position and orientation: six axes, forces and moments. Needs six joints.
    Pose,
}

/// Treatment of joint torques beyond their peak.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TorqueSaturation {
    /// Each joint beyond its peak is cut to it; the others keep their torque, and the force on the foot turns.
    #[default]
    Clip,
    /// All joints are scaled by the smallest peak / |torque|: the direction of the torque stays, and so does that of the
    /// force on the foot. The whole torque is scaled, gravity compensation included: a saturated limb also sinks. A rate
    /// limit scales the steps of all joints together, too.
    Scale,
}

/// Placement of the real-time threads for which the settings name no core.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Placement {
    /// All on one core: steal time then delays the plant's timer too, so that time slips and no tick is missed.
    #[default]
    OneCore,
    /// On any core that the scheduler chooses.
    Free,
}

/// What follows when the log can no longer be written.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum OnFailure {
    /// The run stops: a run without its log is worth nothing.
    #[default]
    Stop,
    /// Control goes on without a log; the summary counts what is missing.
    Continue,
}

/// Physics engine of the plant.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum EngineKind {
    /// The plant's own engine, with the contact laws of the surfaces.
    #[default]
    Hapfic,
    /// rapier, with one softness for all contacts.
    Rapier,
}

/// Reaction of a run to the loss of its plant.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum OnLoss {
    /// The run fails: the state of the plant is lost.
    #[default]
    Fail,
    /// The plant restarts from the last state it published.
    Restart,
}

/// Shape of an object, as written.
#[derive(Clone, Copy, Debug, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum ShapeKind {
    /// A box of `size_m`.
    Box,
    /// A ball of `radius_m`.
    Ball,
}

/// Preset of all policies of the controller.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fidelity {
    /// The choices of this project; each policy can be set separately.
    #[default]
    Hapfic,
    /// search = "sign", reset_policy = "as_printed", saturation = "as_printed", no improvement.
    Paper,
}
