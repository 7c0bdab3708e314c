//! Adaptive taper: the gain of the haptic search follows what the wall allows, without a model of it.

/// Taper at which the search of a new contact starts.
const START: f64 = 0.05;
/// Smallest taper, and the smallest one while the force oscillates.
const LEAST: f64 = 0.015;
const LEAST_OSCILLATING: f64 = 0.012;
/// Smoothed force error above which the force oscillates or moves, as a share of F_d.
const OSCILLATING: f64 = 0.03;
/// Factor of the taper at each change of sign of the force error.
const SHRINK: f64 = 0.5;
/// Time in which the taper grows by e [s].
const GROWTH_S: f64 = 0.05;
/// Time constant of the smoothed force error [s].
const SMOOTHING_S: f64 = 0.02;
/// Force error below which the taper does not grow, as a share of F_d: what is left is no longer a matter of speed, and
/// growth would keep up a small oscillation.
const SMALL: f64 = 0.003;
/// Rate of decay of the force error below which the taper grows [1/s].
const SLOW_DECAY_PER_S: f64 = 20.0;

/// Taper of the search on one axis.
///
/// The search is an integrator of gain `k_i = taper / 1 ms` on the resonance of foot and wall. The loop is stable while
/// (Routh)
///
/// ```text
/// k_i k_e / (k_e + K0) < (b_eff - K0 tau) / m_eff
/// ```
///
/// with the stiffness k_e of the wall, all damping b_eff, the delay tau and the effective mass m_eff. A soft wall (small
/// k_e) allows and needs a large k_i, a stiff and lightly damped one allows only a small k_i. Near the limit the force
/// error changes its sign in every half period; each change halves the taper. It grows otherwise, but not while the error
/// falls by e in 50 ms or faster, nor below 0.3 % of F_d: a search that is fast enough keeps its margin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AdaptiveTaper {
    /// Share of the force error that the search removes in 1 ms, as if against K0; 0 before the first contact.
    pub taper: f64,
    /// Last F_d - F beyond the resolution [N]; 0 before the first contact.
    pub force_error: f64,
    /// |F_d - F|, smoothed over 20 ms [N]; 0 before the first contact.
    pub slow_error: f64,
}

impl AdaptiveTaper {
    /// Runs one control tick in contact, under a desired force F_d and a force error F_d - F [N].
    ///
    /// A change of sign counts from one force error beyond `resolution` [N] to the next one. The taper stays within
    /// [0.015, `most`], or [0.012, `most`] while the smoothed error is above 3 % of F_d, or at `most` if that is smaller.
    /// A force error or `most` that is not finite changes nothing.
    #[must_use]
    pub fn step(self, desired: f64, force_error: f64, resolution: f64, most: f64, period_s: f64) -> Self {
        if !force_error.is_finite() || !most.is_finite() {
            return self;
        }
        let oscillates = self.slow_error > OSCILLATING * desired.abs();
        let least = if oscillates { LEAST_OSCILLATING } else { LEAST }.min(most);
        let started = self.taper > 0.0;
        let size = force_error.abs();
        let (before, slow) = if started { (self.taper, self.slow_error) } else { (START, size) };
        let slow_error = slow + (size - slow) * (1.0 - (-period_s / SMOOTHING_S).exp());
        // Within the resolution the error has no sign: the last one counts on.
        if size < resolution {
            return Self { taper: before.clamp(least, most), slow_error, ..self };
        }
        // An exponential decay of rate r keeps |error| at (1 - r SMOOTHING_S) of the smoothed one.
        let falls_fast = size <= (1.0 - SLOW_DECAY_PER_S * SMOOTHING_S) * slow_error;
        let factor = if self.force_error * force_error < 0.0 {
            SHRINK
        } else if falls_fast || size < SMALL * desired.abs() {
            1.0
        } else {
            (period_s / GROWTH_S).exp()
        };
        Self { taper: (factor * before).clamp(least, most), force_error, slow_error }
    }
}
