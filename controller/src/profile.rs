//! Force profile: force of the controller at a position error (eq. 4).

use core::f64::consts::PI;
use hapfic_messages::Saturation;

/// Share of the last 5 % of a softening profile at which it counts as saturated.
const SATURATED_SHARE: f64 = 0.999;
/// Share of x_b, or of the largest force of a softening profile, up to which the profile is linear.
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
        if self.saturation == Saturation::Softening {
            let largest = self.largest();
            let (linear, knee) = (self.stiffness * distance, KNEE * largest);
            let beyond = (linear - knee).max(0.0);
            let magnitude = if beyond > 0.0 { knee + (largest - knee) * (beyond / (largest - knee)).tanh() } else { linear };
            // The fraction is NaN for a force limit of zero.
            return if magnitude.is_finite() { magnitude.min(largest).copysign(error) } else { 0.0 };
        }
        // F_0. The limit at F_max changes no result, but keeps an overflowing product out of the sum below.
        let knee = (KNEE * self.stiffness * bound).min(self.max_force);
        let magnitude = if distance <= KNEE * bound {
            self.stiffness * distance
        } else {
            let scale = match self.saturation {
                Saturation::AsPrinted => AS_PRINTED,
                Saturation::Continuous | Saturation::Softening => CONTINUOUS,
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
        if self.saturation == Saturation::Softening {
            let largest = self.largest();
            let knee = KNEE * largest;
            let share = ((force.abs() - knee) / (largest - knee)).clamp(0.0, SATURATED_SHARE);
            let linear = if force.abs() > knee { knee + (largest - knee) * share.atanh() } else { force.abs() };
            let error = linear / self.stiffness;
            return if error.is_finite() { error.copysign(force) } else { 0.0 };
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

    /// Returns the largest force of this profile [N]: F_max, or min(F_max, K0 x_b) if it softens; zero if the profile is
    /// invalid.
    #[must_use]
    pub fn largest(&self) -> f64 {
        match self.saturation {
            _ if !self.is_valid() => 0.0,
            Saturation::Softening => (self.stiffness * self.position_bound).min(self.max_force),
            Saturation::Continuous | Saturation::AsPrinted => self.max_force,
        }
    }

    fn is_valid(&self) -> bool {
        [self.stiffness, self.max_force, self.position_bound].iter().all(|value| value.is_finite() && *value >= 0.0)
    }
}
