//! Release of a stalled convergence: what stands at_rest on its way back starts anew from there.

use crate::attractor::Attractor;
use crate::profile::ForceProfile;

/// Error rate below which an axis stands at_rest, m/s.
const STILL_M_PER_S: f64 = 1e-3;
/// How long it has to stand at_rest, s.
const STILL_S: f64 = 0.020;

/// Detects a convergence that has stalled, on one axis.
///
/// In convergence the force crosses zero half way back (eq. 1). An axis damped so strongly that it has no speed left there
/// stands at_rest with no force on it, up to `x_max / 2` off its reference, and its own field even pushes it back out when
/// something else drives it nearer. After 20 ms below 1 mm/s the error is latched anew, and the profile pulls with F_c(e).
///
/// This gives no energy that was not stored: for a profile with `F_max <= 0.95 K0 x_b` the convergence's force towards the
/// reference never exceeds the profile's at the same error, `2 F_c(M) / M (e - M / 2) <= F_c(e)` for every `|e| <= |M|`, so
/// over any way back, with any number of releases, the robot gets at most what it stored on the way out along the profile. And
/// what a release offers, `F_c(e) |e| / 4`, falls from one to the next, as `|e|` does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stall {
    /// Ticks in a row in which the axis stood at_rest in convergence without contact. Starts at 0.
    pub at_rest_ticks: u32,
}

/// What the detection looks at in a tick, after the attractor's step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StallInput {
    /// e, m.
    pub error: f64,
    /// e', m/s.
    pub error_rate: f64,
    /// The attractor's force, N.
    pub force: f64,
    /// F, measured reaction, N: an axis in contact has every reason to stand.
    pub contact_force: f64,
    /// sigma as a threshold, N: forces up to it are no contact, and less than it is no force to be gained.
    pub force_resolution: f64,
    /// Control tick, s.
    pub period_s: f64,
}

impl Stall {
    /// One control tick after the attractor's: the states after it and the force, N.
    ///
    /// Releases only where the profile pulls harder towards the reference than the attractor does, by more than the force
    /// resolution; so also where the attractor pushes away, beyond half way, and never for less than can be measured.
    #[must_use]
    pub fn step(self, attractor: Attractor, input: &StallInput, profile: &ForceProfile) -> (Self, Attractor, f64) {
        // A number that is not finite compares as false: moving, or in contact.
        let free = input.contact_force.abs() <= input.force_resolution;
        let at_rest = attractor.converging && free && input.error_rate.abs() < STILL_M_PER_S;
        if !at_rest {
            return (Self::default(), attractor, input.force);
        }
        let at_rest_ticks = self.at_rest_ticks.saturating_add(1);
        let fresh = profile.force(input.error);
        // Towards the reference is positive here.
        let gain = (fresh - input.force) * input.error.signum();
        let long_enough = f64::from(at_rest_ticks) >= (STILL_S / input.period_s).round();
        if long_enough && gain > input.force_resolution {
            return (Self::default(), Attractor { x_max_m: input.error, ..attractor }, fresh);
        }
        (Self { at_rest_ticks }, attractor, input.force)
    }
}
