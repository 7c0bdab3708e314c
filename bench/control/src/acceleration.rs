//! The velocity-dependent part of the tip's acceleration.

use hapfic_robot::{Chain, JointKind, Kinematics};
use nalgebra::Vector3;

/// J' q': acceleration of the tip at constant joint velocities `qd` [rad/s or m/s], world frame [m/s^2].
///
/// Panics if `qd` is shorter than [`Chain::dof`].
#[must_use]
pub fn tip_bias_acceleration(chain: &Chain, kin: &Kinematics, qd: &[f64]) -> Vector3<f64> {
    let mut angular_velocity: Vector3<f64> = Vector3::zeros();
    let mut angular_acceleration: Vector3<f64> = Vector3::zeros();
    let mut acceleration: Vector3<f64> = Vector3::zeros();
    let mut previous = kin.body_origin(0);
    for (i, (joint, &rate)) in chain.joints().iter().zip(&qd[..chain.dof()]).enumerate() {
        let (axis, origin) = (kin.joint_axis(i), kin.body_origin(i));
        acceleration += rotating_frame_acceleration(&angular_velocity, &angular_acceleration, &(origin - previous));
        previous = origin;
        if joint.kind == JointKind::Prismatic {
            acceleration += angular_velocity.cross(&axis) * (2.0 * rate);
        } else {
            angular_acceleration += angular_velocity.cross(&axis) * rate;
            angular_velocity += axis * rate;
        }
    }
    acceleration + rotating_frame_acceleration(&angular_velocity, &angular_acceleration, &(kin.tip_position() - previous))
}

/// Acceleration of a point at `arm` from the origin of a rotating body.
fn rotating_frame_acceleration(
    angular_velocity: &Vector3<f64>,
    angular_acceleration: &Vector3<f64>,
    arm: &Vector3<f64>,
) -> Vector3<f64> {
    angular_acceleration.cross(arm) + angular_velocity.cross(&angular_velocity.cross(arm))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_config::Settings;

    #[test]
    fn tip_bias_acceleration_constant_joint_velocities_equals_velocity_change() {
        let chain = Chain::from_settings(&Settings::load("floor", &[]).unwrap().robot).unwrap();
        let (q, qd) = ([0.2, 0.9, -1.8], [1.5, -2.0, 3.0]);
        let velocity = |t: f64| {
            let moved: Vec<f64> = q.iter().zip(&qd).map(|(q, qd)| q + t * qd).collect();
            chain.jacobian(&chain.kinematics(&moved)).linear_mul(&qd)
        };
        let h = 1e-5;
        let expected = (velocity(h) - velocity(-h)) / (2.0 * h);
        let found = tip_bias_acceleration(&chain, &chain.kinematics(&q), &qd);
        assert!((found - expected).norm() < 1e-6 * expected.norm(), "found {found}, expected {expected}");
    }
}
