//! Force hold: what changes beside the force in a contact under a desired force does not change the force.

use crate::profile::ForceProfile;

/// Speed at which the offset returns after a loss of contact, or of the desired force [m/s].
const RETURN_M_PER_S: f64 = 0.1;

/// Returns the offset [m] after the reference has moved at `velocity` [m/s] for a tick: it takes the motion back, within
/// +-`bound`.
///
/// On an axis in contact under a desired force the search alone decides on the force. A motion of the reference along
/// this axis would load or unload the wall before the search notices.
#[must_use]
pub(crate) fn follow(offset: f64, velocity: f64, bound: f64, period_s: f64) -> f64 {
    let followed = offset - velocity * period_s;
    // An offset at its bound stays there; it never moves against the reference to get back within.
    if followed.abs() <= bound { followed } else { offset.clamp(-bound, bound) }
}

/// Time without contact in which the offset stays [s]: a foot that bounces keeps what its search has found.
const BOUNCE_S: f64 = 0.05;
/// Longest time without contact that is counted [s].
const LONGEST_S: f64 = 1.0;

/// Returns the time without contact after a tick [s].
#[must_use]
pub(crate) fn free_time(before: f64, free: bool, period_s: f64) -> f64 {
    if free { (before.max(0.0) + period_s).min(LONGEST_S) } else { 0.0 }
}

/// Whether a contact under a desired force was lost just now, and may be a bounce.
#[must_use]
pub(crate) fn bounces(free_s: f64) -> bool {
    free_s < BOUNCE_S
}

/// Returns the offset [m] on its way to zero, without contact or desired force.
///
/// A step to zero would release the force that dx stood for at once.
#[must_use]
pub(crate) fn returned(offset: f64, period_s: f64) -> f64 {
    let most = RETURN_M_PER_S * period_s;
    if offset.abs() <= most { 0.0 } else { offset - most.copysign(offset) }
}

/// Contact of an axis at a change of gains.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contact {
    /// F_d [N].
    pub(crate) desired: f64,
    /// F [N].
    pub(crate) measured: f64,
    /// Force of the attractor in the tick before [N].
    pub(crate) before: f64,
    /// Force of the attractor under the new gains, with the offset of the tick before [N].
    pub(crate) unchanged: f64,
}

impl Contact {
    /// Returns the offset [m] under which new gains leave the reaction between F and F_d; `None` if a number overflows.
    ///
    /// The wall balances a change of the attractor's force: the reaction falls by what F_c gains. `distance` is x_d - x
    /// [m]. The profile gives this force at the new offset, and the attractor starts anew there, also where the present
    /// offset would do: a convergence hides from the prediction what its profile gives at the next divergence.
    #[must_use]
    pub(crate) fn refit(&self, distance: f64, profile: &ForceProfile) -> Option<f64> {
        let predicted = self.measured - (self.unchanged - self.before);
        let kept = predicted.clamp(self.measured.min(self.desired), self.measured.max(self.desired));
        if !kept.is_finite() {
            return None;
        }
        let force = self.before + (self.measured - kept);
        let bound = profile.position_bound.max(0.0);
        let offset = profile.error_for(force) - distance;
        offset.is_finite().then(|| offset.clamp(-bound, bound))
    }
}
