//! Anti-windup of the searched offset: conditional integration at F_max, and a bumpless offset after a change of gains.
//!
//! Both rules change only the offset, before the law computes the error. The paper has neither (decision 8).

use crate::profile::ForceProfile;

/// Share of F_max above which the force counts as saturated.
///
/// The tanh of the profile reaches F_max only in the limit; at x_b it is within 0.2 % of `F_max - F_0`.
const SATURATED: f64 = 0.999;

/// Returns the offset [m] under which new gains give the `force` [N] of the old ones, within +-x_b.
///
/// `distance` is the planned distance x_d - x [m]. The rule is not `dx K0_old / K0_new`: where the target lies in a
/// body, the distance carries a part of the force, and that rule scales this part by `K0_new / K0_old`. It also
/// releases immediately the force that F_max limited before, when F_max rises.
#[must_use]
pub fn bumpless_offset(distance: f64, force: f64, profile: &ForceProfile) -> f64 {
    let bound = profile.position_bound;
    let bound = if bound.is_finite() { bound.max(0.0) } else { 0.0 };
    let offset = profile.error_for(force) - distance;
    if offset.is_nan() { 0.0 } else { offset.clamp(-bound, bound) }
}

/// Returns the offset of the next tick [m]: `proposed`, or `before` if the step winds up.
///
/// `force` is the attractor's force at the offset `before` [N]. At `max_force` [N] a step away from zero in the
/// direction of the force adds no force, and the search has to undo it later; the offset then stays. Every other step
/// is free: out of the saturation, and towards zero, as after a loss of contact.
///
/// The attractor's force decides, not the profile's. In convergence it may be far below F_max even beyond x_b; an
/// offset held there can leave the contact below its desired force permanently.
#[must_use]
pub fn conditional_integration(before: f64, proposed: f64, force: f64, max_force: f64) -> f64 {
    let saturated = force.abs() >= SATURATED * max_force;
    // Compares signs, because a product of small numbers underflows.
    let deeper = (proposed > before && force > 0.0) || (proposed < before && force < 0.0);
    if saturated && deeper && proposed.abs() > before.abs() { before } else { proposed }
}
