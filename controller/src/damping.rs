//! Damping of the position error, without a model of the robot.

/// Returns a force with damping [N]: `force + damping sqrt(K0) e'`, within +-`largest`.
///
/// `damping` [kg^1/2] times sqrt(K0) is 2 zeta sqrt(K0 m) for the damping ratio zeta at the effective mass m, so it scales
/// with K0 as a damping ratio does. The limit only shortens the added part: it keeps the sign of e' and thus never gives
/// energy to the error. Values that are not finite add nothing.
#[must_use]
pub fn damped(force: f64, error_rate: f64, damping: f64, stiffness: f64, largest: f64) -> f64 {
    let added = damping * stiffness.max(0.0).sqrt() * error_rate;
    let sum = force + added;
    if sum.is_finite() { sum.clamp(-largest, largest) } else { force }
}
