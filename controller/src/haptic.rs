//! Haptic search: finds the offset of the reference at which the measured reaction matches the desired one (Algorithm
//! 1).

use hapfic_messages::{ResetPolicy, Search};

/// Tick of the paper's step sizes [s].
const PAPER_PERIOD_S: f64 = 1e-3;

/// Parameters of the haptic search on one axis (Algorithm 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HapticParameters {
    /// Stiffness K0 [N/m], > 0. Raising it slows the search in metres; its rate in newtons stays.
    pub stiffness: f64,
    /// Position bound x_b [m], >= 0: the offset stays within +-x_b. Raising it lets the search reach deeper.
    pub position_bound: f64,
    /// Full steps, or steps that shrink with the force error.
    pub search: Search,
    /// Treatment of the offset while the search is at rest.
    pub reset_policy: ResetPolicy,
    /// Share of the force error that the search removes in 1 ms, as if against K0: of this tick, if it adapts. Raising it
    /// settles faster; from 0.8 on it limit-cycles.
    pub taper: f64,
    /// Sigma as a scale, dimensionless, 0.01 in the paper: a full step in 1 ms is this share of `F_d / K0`.
    pub search_scale: f64,
    /// Sigma as a threshold [N], 0.01 in the paper: a force error below it counts as matched, a force up to it as no
    /// contact.
    pub force_resolution: f64,
    /// Control tick [s]. The step grows with it, so that the search speed does not depend on the rate.
    pub period_s: f64,
}

/// Haptic search on one axis (Algorithm 1).
///
/// Moves the reference into or away from the surface until the measured reaction matches the desired one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HapticSearch {
    /// dx, offset added to the planned position [m]. Stays within +-x_b. Starts at 0.
    pub offset_m: f64,
}

impl HapticSearch {
    /// Runs one control tick. `desired` is F_d and `measured` is F, reactions on the end-effector in the world frame
    /// [N].
    ///
    /// The offset respects the bound of this tick, also where the policy keeps it and the bound has shrunk. A force
    /// that is not finite keeps the offset. An offset that is not finite becomes zero, as does every offset under a
    /// bound that is not a finite, positive number.
    #[must_use]
    pub fn step(self, desired: f64, measured: f64, p: &HapticParameters) -> Self {
        let offset = if self.offset_m.is_finite() { self.offset_m } else { 0.0 };
        let bound = if p.position_bound.is_finite() { p.position_bound.max(0.0) } else { 0.0 };
        let next = if desired.is_finite() && measured.is_finite() { search(offset, desired, measured, p) } else { offset };
        Self { offset_m: next.clamp(-bound, bound) }
    }
}

/// Returns the offset of the next tick before its bound [m]. Forces are finite.
fn search(offset: f64, desired: f64, measured: f64, p: &HapticParameters) -> f64 {
    let force_error = desired - measured;
    if force_error.abs() >= p.force_resolution && desired != 0.0 {
        if measured.abs() <= p.force_resolution {
            return 0.0;
        }
        return offset - direction(force_error) * step_length(desired, force_error, p);
    }
    match p.reset_policy {
        ResetPolicy::ContactLoss if desired == 0.0 => 0.0,
        ResetPolicy::ContactLoss | ResetPolicy::Never => offset,
        ResetPolicy::AsPrinted => 0.0,
    }
}

/// Returns the step of the offset in this tick [m].
///
/// Algorithm 1 prints sigma F_d / K0. The absolute value replaces it because a negative F_d searches away from its
/// target.
fn step_length(desired: f64, force_error: f64, p: &HapticParameters) -> f64 {
    let per_newton = p.period_s / PAPER_PERIOD_S / p.stiffness;
    let full = p.search_scale * desired.abs() * per_newton;
    let tapered = p.taper * force_error.abs() * per_newton;
    let length = match p.search {
        Search::Sign => full,
        Search::Tapered => full.min(tapered),
        // Without the full step: a deep preload is left in proportion to itself, not to a small F_d.
        Search::Adaptive => tapered,
    };
    // Without a stiffness no offset gives a force, so the search does not move.
    if length.is_finite() { length } else { 0.0 }
}

/// Returns the sign of a number, 0 for 0.
fn direction(value: f64) -> f64 {
    if value == 0.0 { 0.0 } else { value.signum() }
}
