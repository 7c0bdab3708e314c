//! The fractal attractor: the force profile on the way out, a softer harmonic field on the way back (eq. 1).

use crate::profile::ForceProfile;

/// Latched errors below this are no distance to converge over, m: the profile itself acts.
const SMALLEST_M: f64 = 1e-9;

/// The fractal attractor of one axis (eq. 1).
///
/// While the error grows the profile's energy is stored; while it shrinks the force is linear about the middle of the way
/// back and gives back nothing in sum over it. The net work on the robot over a closed cycle of the error (reference and
/// parameters fixed) is then never positive, if `F_c(e) / e` nowhere grows with `|e|`: so for every profile with
/// `F_max <= 0.95 K0 x_b`. A profile that hardens (F_max well above `K0 x_b`) is passive over whole excursions from zero
/// error and back, but may give energy in small cycles across its knee; that is the law's, not an error here.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Attractor {
    /// The error latched at the start of the last convergence, m. Starts at 0.
    pub x_max_m: f64,
    /// True in convergence. Starts in divergence.
    pub converging: bool,
}

impl Attractor {
    /// One control tick: the state after it and the force, N, for an error (m) and its rate (m/s).
    ///
    /// The present profile always counts, also for an error latched under an older one. An error or rate that is not
    /// finite gives no force and leaves the phase as it is.
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
        let force = if converging && x_max_m.abs() >= SMALLEST_M {
            // 2 F_c(|x_max|) / |x_max| (e - x_max / 2), ordered so that nothing overflows: the fraction is within +-1.
            profile.force(x_max_m.abs()) * (2.0 * (error - 0.5 * x_max_m) / x_max_m.abs())
        } else {
            profile.force(error)
        };
        let largest = profile.largest();
        (Self { x_max_m, converging }, force.clamp(-largest, largest))
    }
}
