//! Release of a stalled convergence: restarts the convergence of an axis that came to rest before its reference.

use crate::attractor::Attractor;
use crate::profile::ForceProfile;

/// Error rate below which an axis is at rest [m/s].
const AT_REST_M_PER_S: f64 = 1e-3;
/// Time at rest after which a stall is released [s].
const AT_REST_S: f64 = 0.020;

/// Detector of a stalled convergence on one axis.
///
/// In convergence the force crosses zero at half of the latched error (eq. 1). A strongly damped axis has no speed left
/// there. It comes to rest without force, up to `x_max / 2` off its reference. Beyond that point the attractor even
/// pushes it away from the reference. After 20 ms below 1 mm/s the release latches the error again, and the profile
/// acts with F_c(e).
///
/// A release adds no energy. For a profile with `F_max <= 0.95 K0 x_b` the force of the convergence towards the
/// reference never exceeds the profile's at the same error: `2 F_c(M) / M (e - M / 2) <= F_c(e)` for every `|e| <=
/// |M|`. Over any return, with any number of releases, the robot gets at most the energy that the profile stored. The
/// energy that a release offers, `F_c(e) |e| / 4`, falls from one release to the next with `|e|`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stall {
    /// Consecutive ticks at rest in convergence without contact. Starts at 0.
    pub at_rest_ticks: u32,
}

/// Inputs of the detector in a tick, after the attractor's step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StallInput {
    /// e [m].
    pub error: f64,
    /// e' [m/s].
    pub error_rate: f64,
    /// Force of the attractor [N].
    pub force: f64,
    /// Measured reaction F [N]; an axis in contact is not stalled.
    pub contact_force: f64,
    /// Sigma as a threshold [N]: a force up to it is no contact, and a release must gain more than it.
    pub force_resolution: f64,
    /// Control tick [s].
    pub period_s: f64,
}

impl Stall {
    /// Whether an error rate [m/s] is that of an axis at rest.
    pub(crate) fn is_at_rest(error_rate: f64) -> bool {
        error_rate.abs() < AT_REST_M_PER_S
    }

    /// Whether the axis has been at rest for 20 ms.
    pub(crate) fn is_long(&self, period_s: f64) -> bool {
        f64::from(self.at_rest_ticks) >= (AT_REST_S / period_s).round()
    }

    /// Runs one control tick after the attractor's step: returns the next states and the force [N].
    ///
    /// It releases only if the profile's force towards the reference exceeds the attractor's by more than the force
    /// resolution. That includes the range beyond half of x_max, where the attractor pushes away, and excludes gains
    /// below the sensor's resolution.
    #[must_use]
    pub fn step(self, attractor: Attractor, input: &StallInput, profile: &ForceProfile) -> (Self, Attractor, f64) {
        // A nan compares as false: moving, or in contact.
        let free = input.contact_force.abs() <= input.force_resolution;
        let at_rest = attractor.converging && free && Self::is_at_rest(input.error_rate);
        if !at_rest {
            return (Self::default(), attractor, input.force);
        }
        let at_rest_ticks = self.at_rest_ticks.saturating_add(1);
        let fresh = profile.force(input.error);
        // Positive: towards the reference.
        let gain = (fresh - input.force) * input.error.signum();
        if (Self { at_rest_ticks }).is_long(input.period_s) && gain > input.force_resolution {
            return (Self::default(), Attractor { x_max_m: input.error, ..attractor }, fresh);
        }
        (Self { at_rest_ticks }, attractor, input.force)
    }
}
