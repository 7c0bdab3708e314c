//! Choices written as a word.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The step of the haptic search (Algorithm 1).
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Search {
    /// Steps shrink with the force error: the search settles.
    #[default]
    Tapered,
    /// A full step every tick, the paper's: a limit cycle of about one step remains.
    Sign,
}

/// What happens to the searched offset when the force is matched or none is wished (Algorithm 1, `Reset`).
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ResetPolicy {
    /// dx returns to zero when no force is wished and is kept while the force is matched.
    #[default]
    ContactLoss,
    /// dx returns to zero whenever the search rests, as printed with `Reset = true`: the force collapses when it is matched.
    AsPrinted,
    /// dx is always kept (`Reset = false`).
    Never,
}

/// How the force profile saturates (eq. 4).
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Saturation {
    /// S = 0.05 / (2 pi): within the last 5 % of x_b, as the paper's prose says.
    #[default]
    Continuous,
    /// S = 0.1353, the printed value: the force steps at 0.95 x_b.
    AsPrinted,
}

/// Where the real-time threads run that have no core of their own in the settings.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Placement {
    /// All on one core: a host that takes that core away delays the plant's timer too, so that time slips and no tick is missed.
    #[default]
    OneCore,
    /// Wherever the scheduler puts them.
    Free,
}

/// What becomes of a run whose plant is lost.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum OnLoss {
    /// The run fails: with the plant, what the run was about is gone.
    #[default]
    Fail,
    /// The plant is started again from the last state it published.
    Restart,
}

/// Form of an object, as written.
#[derive(Clone, Copy, Debug, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum ShapeKind {
    /// A box of `size_m`.
    Box,
    /// A ball of `radius_m`.
    Ball,
}

/// One word for how close to print the controller is.
#[derive(Clone, Copy, Debug, Default, Deserialize, Eq, JsonSchema, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fidelity {
    /// This project's choices; each policy can be set on its own.
    #[default]
    Hapfic,
    /// search = "sign", reset_policy = "as_printed", saturation = "as_printed", no improvement.
    Paper,
}
