//! Anti-windup of the searched offset: it stays where F_max holds the force, and keeps the force when the gains change.
//!
//! Both rules act on the offset alone, before the error is made from it; the paper has neither.

use crate::profile::ForceProfile;

/// Share of F_max from which on the force counts as saturated: the profile's tanh reaches F_max only in the limit, and is
/// within 0.2 % of `F_max - F_0` at x_b.
const SATURATED: f64 = 0.999;

/// The offset, m, under which new gains press with the `force`, N, that the old ones gave. `distance` is the planned way to go,
/// x_d - x, m. Within +-x_b.
///
/// Not `dx K0_old / K0_new`: where the target lies in a body, the distance carries a part of the force, and would carry it
/// `K0_new / K0_old` times over; and what F_max held back would come at once when F_max is raised.
#[must_use]
pub fn bumpless_offset(distance: f64, force: f64, profile: &ForceProfile) -> f64 {
    let bound = profile.position_bound;
    let bound = if bound.is_finite() { bound.max(0.0) } else { 0.0 };
    let wanted = profile.error_for(force) - distance;
    if wanted.is_nan() { 0.0 } else { wanted.clamp(-bound, bound) }
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
pub fn conditional_integration(before: f64, wanted: f64, force: f64, max_force: f64) -> f64 {
    let saturated = force.abs() >= SATURATED * max_force;
    // Signs, not products: a product of small numbers could vanish.
    let deeper = (wanted > before && force > 0.0) || (wanted < before && force < 0.0);
    if saturated && deeper && wanted.abs() > before.abs() { before } else { wanted }
}
