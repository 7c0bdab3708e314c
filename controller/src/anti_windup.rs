//! Anti-windup of the searched offset: it stays where F_max holds the force, and keeps its force when the stiffness changes.
//!
//! Both rules act on the offset alone, before the error is made from it; the paper has neither.

/// Share of F_max from which on the force counts as saturated: the profile's tanh reaches F_max only in the limit, and is
/// within 0.2 % of `F_max - F_0` at x_b.
const SATURATED: f64 = 0.999;

/// The offset, m, that stands for the same force under another stiffness: `dx K0_old / K0_new`, within +-`bound`, m; a bound
/// below zero counts as zero.
///
/// A stiffness that is not positive means that there is no older one, or none that could be scaled to: dx stays, within its
/// bound.
#[must_use]
pub fn rescaled(offset: f64, older: f64, newer: f64, bound: f64) -> f64 {
    let scaled = if older > 0.0 && newer > 0.0 && older != newer { offset * (older / newer) } else { offset };
    let bound = bound.max(0.0);
    // Not a number is zero times a ratio that overflows.
    if scaled.is_nan() { 0.0 } else { scaled.clamp(-bound, bound) }
}

/// The offset that the search may take, m: `wanted`, unless that winds up.
///
/// `force` is what the attractor gives, N, while the offset stays at `before`, m. Where that is at `max_force`, N, a step of the
/// offset away from zero in the force's own direction adds no force but has to be searched back later, so the offset stays.
/// Every other step is free: out of the saturation, and towards zero, as when contact is lost.
///
/// The attractor's force decides, not the profile's, because it is what acts: in convergence it may be far below F_max beyond
/// x_b too, and to hold the offset there could leave a contact short of its force for good.
#[must_use]
pub fn held_back(before: f64, wanted: f64, force: f64, max_force: f64) -> f64 {
    let saturated = force.abs() >= SATURATED * max_force;
    // Signs, not products: a product of small numbers could vanish.
    let deeper = (wanted > before && force > 0.0) || (wanted < before && force < 0.0);
    if saturated && deeper && wanted.abs() > before.abs() { before } else { wanted }
}
