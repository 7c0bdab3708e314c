//! Adaptive taper: the gain of the haptic search follows what the wall allows, without a model of it.

/// Taper at which the search of a new contact starts.
const START: f64 = 0.05;
/// Smallest taper.
const LEAST: f64 = 0.015;
/// Factor of the taper at each change of sign of the force error.
const SHRINK: f64 = 0.5;
/// Time in which the taper grows by e [s].
const GROWTH_S: f64 = 0.05;
/// Time constant of the smoothed force error [s].
const SMOOTHING_S: f64 = 0.02;
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
/// falls by e in 50 ms or faster: a search that is fast enough keeps its margin.
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
    /// Runs one control tick in contact, under a desired force.
    ///
    /// A change of sign counts from one force error beyond `resolution` [N] to the next one. The taper stays within
    /// [0.015, `most`], or at `most` if that is smaller. A number that is not finite changes nothing.
    #[must_use]
    pub fn step(self, force_error: f64, resolution: f64, most: f64, period_s: f64) -> Self {
        if !force_error.is_finite() || !most.is_finite() {
            return self;
        }
        let least = LEAST.min(most);
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
        } else if falls_fast {
            1.0
        } else {
            (period_s / GROWTH_S).exp()
        };
        Self { taper: (factor * before).clamp(least, most), force_error, slow_error }
    }
}
