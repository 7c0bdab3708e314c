//! The force profile: how hard the controller pulls at a position error (eq. 4).

use core::f64::consts::PI;
use hapfic_messages::Saturation;

/// Share of x_b up to which the profile is linear.
const KNEE: f64 = 0.95;
/// S that saturates in the last 5 % of x_b, as the paper's prose says.
const CONTINUOUS: f64 = 0.05 / (2.0 * PI);
/// S as eq. 4 prints it: steps at the knee.
const AS_PRINTED: f64 = 0.1353;

/// The force profile of one axis, F_c(e) (eq. 4): linear, then saturating at F_max.
///
/// Odd in the error, and `|F_c| <= F_max` for every finite error and every parameter set, also where the parameters do not
/// fit together (`F_max < 0.95 K0 x_b`: the linear part is cut off at F_max).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceProfile {
    /// K0, N/m, >= 0: stiffness of the linear part. Raise it for less error under load.
    pub stiffness: f64,
    /// F_max, N, >= 0: no force exceeds it. Above `K0 x_b` the profile hardens, see [`crate::Attractor`].
    pub max_force: f64,
    /// x_b, m, >= 0: the error at which the force is saturated. Raise it to keep the linear part longer.
    pub position_bound: f64,
    /// How it saturates.
    pub saturation: Saturation,
}

impl ForceProfile {
    /// F_c, N, at an error in m.
    ///
    /// No force if the error or a parameter is not finite, or a parameter negative: there is no meaning in such a profile,
    /// and no force is the safe answer.
    #[must_use]
    pub fn force(&self, error: f64) -> f64 {
        if !self.is_usable() || !error.is_finite() {
            return 0.0;
        }
        let (distance, bound) = (error.abs(), self.position_bound);
        // F_0. Its cut at F_max changes no result, but keeps an overflowing product out of the sum below.
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

    /// An error, m, at which the profile gives a force, N, or the nearest to it that is not more: in the linear part `F / K0`; x_b
    /// for F_max; in between, where a hair's breadth decides over the force, the end of the linear part. Zero where there is none.
    #[must_use]
    pub fn error_for(&self, force: f64) -> f64 {
        if !self.is_usable() || !force.is_finite() || self.stiffness == 0.0 {
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

    /// The largest force this profile can give, N: F_max, or zero if the profile is unusable.
    pub(crate) fn largest(&self) -> f64 {
        if self.is_usable() { self.max_force } else { 0.0 }
    }

    fn is_usable(&self) -> bool {
        [self.stiffness, self.max_force, self.position_bound].iter().all(|value| value.is_finite() && *value >= 0.0)
    }
}
