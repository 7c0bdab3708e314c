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

/// Slope of the force where divergence is entered again, over `F_c(e) / e`.
///
/// No convergence falls faster than 2 `F_c(e) / e`. Rising at least as fast, a small cycle takes energy from the robot.
const REENTRY_SLOPE: f64 = 2.5;

/// Fractal attractor of one axis (eq. 1) whose force is continuous where divergence is entered again in free motion.
///
/// The printed law jumps from the force of the convergence to the profile at the tick at which the robot turns back. With
/// a target out of reach the robot turns back under a force near F_max, is thrown back, and cycles. Here the force rises
/// from where it is, by 2.5 `F_c(e) / e` per metre, up to the profile; and the next convergence starts from the force
/// that is there. In contact the jump stays: it is small there, and takes energy out of oscillations on a wall. Near the
/// reference a convergence may brake with more than the profile; divergence starts at the profile then, because that
/// brake would throw the robot back out.
///
/// The force towards the reference never exceeds the profile's. With a softening profile it lies, on the way out, on or
/// above its way back, so the net work on the robot over a closed cycle of the error that starts from the default state is
/// not positive. A part of such a cycle may return some of the energy that the robot gave before.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContinuousAttractor {
    /// Error at the last change of phase [m]. Starts at 0.
    pub x_max_m: f64,
    /// Force there [N], with the sign of the error where it pulls to the reference. Starts at 0.
    pub x_max_force: f64,
    /// Whether the phase is convergence. Starts in divergence.
    pub converging: bool,
}

impl ContinuousAttractor {
    /// Runs one control tick: returns the next state and the force [N], as [`Attractor::step`].
    ///
    /// `jump` is the largest jump where divergence is entered again [N]: 0 in free motion, infinity for the printed law.
    #[must_use]
    pub fn step(self, error: f64, error_rate: f64, jump: f64, profile: &ForceProfile) -> (Self, f64) {
        if !error.is_finite() || !error_rate.is_finite() || !self.x_max_m.is_finite() || !self.x_max_force.is_finite() {
            return (Self { converging: self.converging, ..Self::default() }, 0.0);
        }
        let growth = error * error_rate;
        let converging = growth < 0.0 || (growth == 0.0 && self.converging);
        // Distances and pulls are along the sign of the error. At the reference and on its other side nothing is left of
        // the past: the profile starts at zero force.
        let same_side = error != 0.0 && self.x_max_m != 0.0 && (error < 0.0) == (self.x_max_m < 0.0);
        let (latched, held) = if same_side { (self.x_max_m.abs(), self.x_max_force * self.x_max_m.signum()) } else { (0.0, 0.0) };
        let distance = error.abs();
        let most = profile.force(distance);
        let rise = |jump: f64| {
            let slope = REENTRY_SLOPE * (most / distance.max(MIN_LATCHED_ERROR_M));
            // Where the reference came nearer meanwhile, the force stays. `min` also takes the profile for a NaN of an
            // overflow.
            if latched > 0.0 { (held + jump + slope * (distance - latched).max(0.0)).min(most).max(-most) } else { most }
        };
        // The present profile also counts for a force latched under an older one.
        let fall = || {
            let held = held.min(profile.force(latched));
            if latched < MIN_LATCHED_ERROR_M {
                most
            } else if held > 0.0 {
                held * (2.0 * (distance / latched) - 1.0)
            } else {
                held
            }
        };
        let (latched, held, pull) = match (self.converging && same_side, converging) {
            // Turned back: the rise starts from here.
            (true, false) => {
                let now = fall().clamp(-most, most);
                (distance, now, (now + jump).min(most))
            }
            (true, true) if distance <= latched => (latched, held, fall()),
            // Further out.
            (false, false) => (latched, held, rise(jump)),
            // Turned to the reference.
            (false, true) => {
                let now = rise(jump);
                (distance, now, now)
            }
            // The reference, or the offset, has moved away in convergence: many small steps, none of which jumps.
            (true, true) => {
                let now = if jump.is_finite() { rise(0.0) } else { most };
                (distance, now, now)
            }
        };
        let largest = profile.largest();
        let signed = |pull: f64| pull.clamp(-largest, largest) * if error < 0.0 { -1.0 } else { 1.0 };
        (Self { x_max_m: latched.copysign(error), x_max_force: signed(held), converging }, signed(pull))
    }
}
