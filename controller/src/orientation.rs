//! Orientation error of a pose task.

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

/// Angle from which on the rotation vector's sign is kept [rad]: at pi its two signs mean the same turn.
const AMBIGUOUS_RAD: f64 = 3.0;

/// Rotation vector of `R_d R^T` in world axes [rad]: the turn that takes the tip to its reference, at most pi long.
///
/// Near pi the shortest turn changes its direction at a touch. Beyond 3 rad the turn is taken that lies on the side of
/// `before`, a vector such as the moment of the tick before; then it may be longer than pi.
#[must_use]
pub fn orientation_error(reference: &[f64; 4], tip: &Matrix3<f64>, before: &[f64; 3]) -> [f64; 3] {
    let [x, y, z, w] = *reference;
    let reference = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    let tip = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*tip));
    let turn = (reference * tip.inverse()).scaled_axis();
    let angle = turn.norm();
    if angle > AMBIGUOUS_RAD && turn.dot(&Vector3::from(*before)) < 0.0 {
        return (turn * (1.0 - core::f64::consts::TAU / angle)).into();
    }
    turn.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quaternion(axis: Vector3<f64>) -> [f64; 4] {
        let q = UnitQuaternion::from_scaled_axis(axis);
        [q.i, q.j, q.k, q.w]
    }

    #[test]
    fn error_is_the_turn_in_world_axes() {
        let tip = Rotation3::from_scaled_axis(Vector3::new(0.4, -1.1, 0.3));
        let turn = Vector3::new(0.2, 0.1, -0.3);
        let reference = UnitQuaternion::from_scaled_axis(turn) * UnitQuaternion::from_rotation_matrix(&tip);
        let error = orientation_error(&[reference.i, reference.j, reference.k, reference.w], tip.matrix(), &[0.0; 3]);
        assert!((Vector3::from(error) - turn).norm() < 1e-14, "{error:?}");
        // A quaternion and its negative are the same orientation.
        let negative = [-reference.i, -reference.j, -reference.k, -reference.w];
        assert!((Vector3::from(orientation_error(&negative, tip.matrix(), &[0.0; 3])) - turn).norm() < 1e-14);
    }

    #[test]
    fn error_near_half_turn_keeps_its_side() {
        let tip = Matrix3::identity();
        for angle in [3.1, core::f64::consts::PI, 3.2] {
            let error = orientation_error(&quaternion(Vector3::x() * angle), &tip, &[1.0, 0.0, 0.0]);
            assert!((error[0] - angle).abs() < 1e-9, "{angle}: {error:?}");
            let other = orientation_error(&quaternion(Vector3::x() * angle), &tip, &[-1.0, 0.0, 0.0]);
            assert!((other[0] - (angle - core::f64::consts::TAU)).abs() < 1e-9, "{angle}: {other:?}");
        }
    }
}
