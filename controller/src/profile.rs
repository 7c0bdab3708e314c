//! Force profile: force of the controller at a position error (eq. 4).

use core::f64::consts::PI;
use hapfic_messages::Saturation;

/// Share of x_b up to which the profile is linear.
const KNEE: f64 = 0.95;
/// S that saturates in the last 5 % of x_b, as in the paper's prose.
const CONTINUOUS: f64 = 0.05 / (2.0 * PI);
/// S as printed in eq. 4; the force steps at the knee.
const AS_PRINTED: f64 = 0.1353;

/// Force profile of one axis, F_c(e) (eq. 4): linear, then saturating at F_max.
///
/// It is odd in the error, and `|F_c| <= F_max` for every finite error and every parameter set. With incompatible
/// parameters (`F_max < 0.95 K0 x_b`) F_max cuts off the linear part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceProfile {
    /// Stiffness K0 of the linear part [N/m], >= 0. Raising it reduces the error under load.
    pub stiffness: f64,
    /// Largest force F_max [N], >= 0. Above `K0 x_b` the profile hardens, see [`crate::Attractor`].
    pub max_force: f64,
    /// Position bound x_b: the error at which the force is saturated [m], >= 0. Raising it extends the linear part.
    pub position_bound: f64,
    /// Saturation of the profile.
    pub saturation: Saturation,
}

impl ForceProfile {
    /// Returns F_c [N] at an error [m].
    ///
    /// The force is zero, the safe value, if the error or a parameter is not finite, or a parameter is negative.
    #[must_use]
    pub fn force(&self, error: f64) -> f64 {
        if !self.is_valid() || !error.is_finite() {
            return 0.0;
        }
        let (distance, bound) = (error.abs(), self.position_bound);
        // F_0. The limit at F_max changes no result, but keeps an overflowing product out of the sum below.
        let knee = (KNEE * self.stiffness * bound).min(self.max_force);
        let magnitude = if distance <= KNEE * bound {
            self.stiffness * distance
        } else {
            let scale = match self.saturation {
                Saturation::Continuous => CONTINUOUS,
                Saturation::AsPrinted => AS_PRINTED,
            };
            let progress = (distance / bound - 1.0) / scale + PI;
            0.5 * (self.max_force - knee) * (progress.tanh() + 1.0) + knee
        };
        magnitude.min(self.max_force).copysign(error)
    }

    /// Returns an error [m] at which the profile gives a force [N], or the nearest smaller one.
    ///
    /// It is `F / K0` in the linear part, and x_b for F_max. In between the slope is steep, and the result is the end
    /// of the linear part. It is zero for an invalid profile, an infinite force or zero stiffness.
    #[must_use]
    pub fn error_for(&self, force: f64) -> f64 {
        if !self.is_valid() || !force.is_finite() || self.stiffness == 0.0 {
            return 0.0;
        }
        let (linear, knee) = (force.abs().min(self.max_force) / self.stiffness, KNEE * self.position_bound);
        let error = if linear <= knee {
            linear
        } else if force.abs() >= self.max_force {
            self.position_bound
        } else {
            knee
        };
        error.copysign(force)
    }

    /// Returns the largest force of this profile [N]: F_max, or zero if the profile is invalid.
    pub(crate) fn largest(&self) -> f64 {
        if self.is_valid() { self.max_force } else { 0.0 }
    }

    fn is_valid(&self) -> bool {
        [self.stiffness, self.max_force, self.position_bound].iter().all(|value| value.is_finite() && *value >= 0.0)
    }
}
