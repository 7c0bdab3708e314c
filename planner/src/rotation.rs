//! Plan of the orientation: harmonic arcs along the rotation vector from the target to the reference.
//!
//! The reference is `R_d = exp(r) R_t`, world axes, and r moves to zero as a position does. From rest r keeps its direction:
//! the turn is the shortest one, about a fixed axis, with the speed of a harmonic arc (a slerp). A new target is valid at any
//! tick, and angular velocity stays continuous: `r' = J_l(r)^-1 omega`, with the left Jacobian J_l of SO(3).

use crate::harmonic_arc as arc;
use crate::planner::{PlannerParameters, Setpoint, accept};
use hapfic_messages::{RotationParameters, RotationPlan};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

/// Plan at rest on an orientation: unit quaternion x y z w. Zeros, of a plant that does not measure it, give no plan; the
/// controllers then make no request, and the gate brakes.
pub(crate) fn hold(orientation: &[f64; 4]) -> RotationPlan {
    if *orientation == [0.0; 4] {
        return RotationPlan::default();
    }
    let [x, y, z, w] = *orientation;
    let (roll, pitch, yaw) = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).euler_angles();
    RotationPlan { ticks: 0, exists: 1, target_rpy: [roll, pitch, yaw], axes: [arc::rest(0.0); 3] }
}

/// Plan at rest where a plan is now.
pub(crate) fn held(plan: &RotationPlan, period_s: f64) -> RotationPlan {
    hold(&setpoint(plan, period_s).0)
}

/// Orientation (unit quaternion x y z w) and angular velocity [rad/s] of a plan; all zero if there is none.
pub(crate) fn setpoint(plan: &RotationPlan, period_s: f64) -> ([f64; 4], [f64; 3]) {
    if plan.exists == 0 {
        return ([0.0; 4], [0.0; 3]);
    }
    let (r, rate) = vector(plan, period_s);
    let q = UnitQuaternion::from_scaled_axis(r) * target(&plan.target_rpy);
    ([q.i, q.j, q.k, q.w], (left_jacobian(&r) * rate).into())
}

/// Advances a plan by one tick, and accepts a new target.
///
/// Invalid parameters, or a target that is not finite, leave the plan as it was.
pub(crate) fn step(plan: RotationPlan, p: &RotationParameters, period_s: f64) -> RotationPlan {
    if plan.exists == 0 {
        return plan;
    }
    let mut next = plan;
    if p.target_rpy != plan.target_rpy && p.target_rpy.iter().all(|angle| angle.is_finite()) {
        next = towards(&plan, p, period_s).unwrap_or(plan);
    }
    next.ticks = next.ticks.saturating_add(1);
    next
}

fn towards(plan: &RotationPlan, p: &RotationParameters, period_s: f64) -> Option<RotationPlan> {
    let (r, rate) = vector(plan, period_s);
    let omega = left_jacobian(&r) * rate;
    let now = UnitQuaternion::from_scaled_axis(r) * target(&plan.target_rpy);
    let from = (now * target(&p.target_rpy).inverse()).scaled_axis();
    let rate = left_jacobian(&from).try_inverse()? * omega;
    let parameters = PlannerParameters { mean_speed_m_per_s: p.mean_speed, max_acceleration_m_per_s2: p.max_acceleration };
    let now = Setpoint { position_m: from.into(), velocity_m_per_s: rate.into() };
    Some(RotationPlan { ticks: 0, exists: 1, target_rpy: p.target_rpy, axes: accept([0.0; 3], &now, &parameters)? })
}

/// Rotation vector [rad] and its rate [rad/s].
fn vector(plan: &RotationPlan, period_s: f64) -> (Vector3<f64>, Vector3<f64>) {
    let t = plan.ticks as f64 * period_s;
    let at = plan.axes.map(|axis| arc::evaluate(&axis, t));
    (Vector3::from(at.map(|(angle, _)| angle)), Vector3::from(at.map(|(_, rate)| rate)))
}

fn target(rpy: &[f64; 3]) -> UnitQuaternion<f64> {
    let [roll, pitch, yaw] = *rpy;
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_euler_angles(roll, pitch, yaw))
}

/// `J_l(r) = I + (1 - cos a) / a^2 [r] + (a - sin a) / a^3 [r]^2`, a = |r|: omega = J_l(r) r' for `R = exp(r)`.
fn left_jacobian(r: &Vector3<f64>) -> Matrix3<f64> {
    let (a, cross) = (r.norm(), r.cross_matrix());
    let (first, second) = if a < 1e-4 {
        (0.5 - a * a / 24.0, 1.0 / 6.0 - a * a / 120.0)
    } else {
        ((1.0 - a.cos()) / (a * a), (a - a.sin()) / (a * a * a))
    };
    Matrix3::identity() + cross * first + cross * cross * second
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 1e-3;

    fn parameters(target_rpy: [f64; 3]) -> RotationParameters {
        RotationParameters { target_rpy, mean_speed: 0.5, max_acceleration: 10.0, ..RotationParameters::default() }
    }

    fn orientation(plan: &RotationPlan) -> UnitQuaternion<f64> {
        let ([x, y, z, w], _) = setpoint(plan, PERIOD_S);
        UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
    }

    #[test]
    fn hold_of_any_orientation_is_that_orientation_from_the_first_tick() {
        let identity = ([0.0, 0.0, 0.0, 1.0], [0.0; 3]);
        assert_eq!(setpoint(&hold(&identity.0), PERIOD_S), identity);
        for rpy in [[0.3, -0.2, 2.0], [0.4, core::f64::consts::FRAC_PI_2, 1.0], [3.1, -core::f64::consts::FRAC_PI_2, -2.0]] {
            let q = target(&rpy);
            let plan = hold(&[q.i, q.j, q.k, q.w]);
            assert!(orientation(&plan).angle_to(&q) < 1e-7, "{rpy:?}");
            assert!(orientation(&step(plan, &parameters(plan.target_rpy), PERIOD_S)).angle_to(&q) < 1e-7);
        }
    }

    #[test]
    fn plan_without_measured_orientation_stays_none() {
        let none = hold(&[0.0; 4]);
        assert_eq!(step(none, &parameters([0.1, 0.2, 0.3]), PERIOD_S), none);
        assert_eq!(setpoint(&none, PERIOD_S), ([0.0; 4], [0.0; 3]));
    }

    #[test]
    fn turn_from_rest_is_shortest_and_ends_on_target() {
        let mut plan = hold(&[0.0, 0.0, 0.0, 1.0]);
        let end = target(&[0.3, -0.8, 1.4]);
        let axis = end.scaled_axis().normalize();
        for _ in 0..8000 {
            plan = step(plan, &parameters([0.3, -0.8, 1.4]), PERIOD_S);
            let turned = orientation(&plan).scaled_axis();
            assert!(turned.cross(&axis).norm() < 1e-12, "about another axis: {turned}");
        }
        assert!(orientation(&plan).angle_to(&end) < 1e-12);
        assert_eq!(setpoint(&plan, PERIOD_S).1, [0.0; 3]);
    }

    #[test]
    fn angular_velocity_is_the_rate_of_the_orientation_and_continuous() {
        let mut plan = hold(&[0.0, 0.0, 0.0, 1.0]);
        let mut before: Option<(UnitQuaternion<f64>, Vector3<f64>)> = None;
        for tick in 0..6000 {
            let goal = if tick < 1500 { [0.0, 0.0, 2.5] } else { [1.2, -0.4, 0.1] };
            plan = step(plan, &parameters(goal), PERIOD_S);
            let (now, omega) = (orientation(&plan), Vector3::from(setpoint(&plan, PERIOD_S).1));
            if let Some((last, last_omega)) = before {
                let turned = (now * last.inverse()).scaled_axis() / PERIOD_S;
                // Where an axis has braked and turns to its target, the acceleration steps by up to 2 a_max.
                let kink = if tick < 1500 { 1e-4 } else { 1e-2 };
                assert!((turned - 0.5 * (omega + last_omega)).norm() < kink, "{tick}: {turned} against {omega}");
                // a_max on each axis, and what the turning frame adds.
                assert!((omega - last_omega).norm() < 0.025, "{tick}: {last_omega} to {omega}");
            }
            before = Some((now, omega));
        }
        assert!(orientation(&plan).angle_to(&target(&[1.2, -0.4, 0.1])) < 1e-12);
    }
}
