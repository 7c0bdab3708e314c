//! Fractal attractor: the force profile in divergence, a softer harmonic field in convergence (eq. 1).

use crate::profile::ForceProfile;

/// Smallest latched error [m]; below it the profile acts in convergence too.
const MIN_LATCHED_ERROR_M: f64 = 1e-9;

/// Fractal attractor of one axis (eq. 1).
///
/// In divergence the profile stores energy. In convergence the force is linear about half of the latched error, and its
/// work over the whole convergence is zero. Let `F_c(e) / e` nowhere grow with `|e|`, that is `F_max <= 0.95 K0 x_b`,
/// and fix reference and parameters. Then the net work on the robot over a closed cycle of the error is never positive.
/// A hardening profile (F_max well above `K0 x_b`) is passive over whole excursions from zero error and back. It may
/// give energy in small cycles across its knee; that is a property of the law.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Attractor {
    /// x_max, the error latched at the start of the last convergence [m]. Starts at 0.
    pub x_max_m: f64,
    /// Whether the phase is convergence. Starts in divergence.
    pub converging: bool,
}

impl Attractor {
    /// Runs one control tick: returns the next state and the force [N] for an error [m] and its rate [m/s].
    ///
    /// The present profile always applies, also to an error latched under an older one. An error or rate that is not
    /// finite gives no force and keeps the phase.
    #[must_use]
    pub fn step(self, error: f64, error_rate: f64, profile: &ForceProfile) -> (Self, f64) {
        let latched = if self.x_max_m.is_finite() { self.x_max_m } else { 0.0 };
        if !error.is_finite() || !error_rate.is_finite() {
            return (Self { x_max_m: latched, ..self }, 0.0);
        }
        let growth = error * error_rate;
        let converging = if growth > 0.0 {
            false
        } else if growth < 0.0 {
            true
        } else {
            self.converging
        };
        let entered = converging && !self.converging;
        let renew = entered || error * latched <= 0.0 || error.abs() > latched.abs();
        let x_max_m = if converging && renew { error } else { latched };
        let force = if converging && x_max_m.abs() >= MIN_LATCHED_ERROR_M {
            // 2 F_c(|x_max|) / |x_max| (e - x_max / 2) without overflow: the fraction is within +-1.
            profile.force(x_max_m.abs()) * (2.0 * (error - 0.5 * x_max_m) / x_max_m.abs())
        } else {
            profile.force(error)
        };
        let largest = profile.largest();
        (Self { x_max_m, converging }, force.clamp(-largest, largest))
    }
}
