//! The haptic search: finds the offset of the reference at which the measured reaction is the desired one.

use hapfic_messages::{ResetPolicy, Search};

/// The tick for which the paper's step sizes are meant, s.
const PAPER_PERIOD_S: f64 = 1e-3;

/// What the haptic search needs to know on one axis (Algorithm 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HapticParameters {
    /// K0, N/m, > 0. Raise it and the search moves slower in metres, at the same rate in newtons.
    pub stiffness: f64,
    /// x_b, m, >= 0: the offset stays within +-x_b. Raise it to search deeper.
    pub position_bound: f64,
    /// Full steps, or steps that shrink with the force error.
    pub search: Search,
    /// What happens to the offset while the search rests.
    pub reset_policy: ResetPolicy,
    /// Share of the force error that the tapered search works off in 1 ms, as if against K0; 0.2 by default. Raise it to
    /// settle faster; from 0.8 on it limit-cycles.
    pub taper: f64,
    /// sigma as a scale, dimensionless, 0.01 in the paper: a full step in 1 ms is this share of `F_d / K0`.
    pub search_scale: f64,
    /// sigma as a threshold, N, 0.01 in the paper: force errors below it count as matched, forces up to it as no contact.
    pub force_resolution: f64,
    /// Control tick, s. The step grows with it, so that the search speed does not depend on the rate.
    pub period_s: f64,
}

/// Haptic search on one axis (Algorithm 1).
///
/// Moves the reference into or away from the surface until the measured reaction matches the desired one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HapticSearch {
    /// Offset added to the planned position, dx, m. Stays within +-x_b. Starts at 0.
    pub offset_m: f64,
}

impl HapticSearch {
    /// One control tick. `desired` is F_d and `measured` F, both N, world frame, reaction on the end-effector.
    ///
    /// The offset obeys the bound of this tick, also where it is kept and the bound has shrunk. A force that is not finite
    /// leaves the offset where it is; a bound that is not a finite, positive number brings it to zero, as does an offset
    /// that is not finite.
    #[must_use]
    pub fn step(self, desired: f64, measured: f64, p: &HapticParameters) -> Self {
        let offset = if self.offset_m.is_finite() { self.offset_m } else { 0.0 };
        let bound = if p.position_bound.is_finite() { p.position_bound.max(0.0) } else { 0.0 };
        let next = if desired.is_finite() && measured.is_finite() { search(offset, desired, measured, p) } else { offset };
        Self { offset_m: next.clamp(-bound, bound) }
    }
}

/// The offset of the next tick, before its bound. Forces are finite.
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

/// How far the offset moves in this tick, m.
///
/// Algorithm 1 prints sigma F_d / K0; the absolute value is taken because a negative F_d would search away from its target.
fn step_length(desired: f64, force_error: f64, p: &HapticParameters) -> f64 {
    let per_newton = p.period_s / PAPER_PERIOD_S / p.stiffness;
    let full = p.search_scale * desired.abs() * per_newton;
    let length = match p.search {
        Search::Sign => full,
        Search::Tapered => full.min(p.taper * force_error.abs() * per_newton),
    };
    // Without a stiffness no offset makes a force: there is nothing to search.
    if length.is_finite() { length } else { 0.0 }
}

/// The sign of a number, 0 for 0.
fn direction(value: f64) -> f64 {
    if value == 0.0 { 0.0 } else { value.signum() }
}
