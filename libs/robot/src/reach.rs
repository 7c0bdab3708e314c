//! Inverse kinematics of the tip's position: whether the joints, within their limits, reach a point.

use crate::chain::{Chain, JointVector, MAX_JOINTS};
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::PI;

/// Starts besides the given one, spread over the joint ranges.
const STARTS: usize = 15;
/// Most steps from one start.
const STEPS: usize = 80;
/// Distance at which a point counts as reached and the search ends [m].
const REACHED_M: f64 = 1e-6;
/// Smallest gain of a step at which a start is given up [m].
const LEAST_GAIN_M: f64 = 1e-9;
/// Damping of the first step, relative to the mean square of the Jacobian.
const DAMPING: f64 = 1e-3;
/// Damping beyond which no step helps.
const LARGEST_DAMPING: f64 = 1e6;
/// Joints without limits start within this range [rad].
const UNLIMITED: f64 = PI;

/// Posture that brings the tip as near to a point as the joints allow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// The posture, within the joint limits [rad or m].
    pub q: JointVector,
    /// Position of the tip in it [m].
    pub position: Vector3<f64>,
    /// Distance of the tip from the point [m]; zero, to a micrometre, if the point is reachable.
    pub distance_m: f64,
}

impl Chain {
    /// Finds a posture within the joint limits whose tip is at a point [m], or as near to it as the search gets.
    ///
    /// Damped least squares on the position alone, from the posture `start` first, then from others spread over the joint
    /// ranges: the same every time. A point out of reach of the embedded leg takes 0.2 ms. The orientation of the tip is
    /// free. A local minimum of all starts makes a reachable point look unreachable; the
    /// starts make that rare, not impossible.
    ///
    /// Panics if `start` is shorter than [`Chain::dof`].
    #[must_use]
    pub fn reach(&self, point: &Vector3<f64>, start: &[f64]) -> Reach {
        let mut best = self.descend(point, self.within_limits(start));
        for index in 1..=STARTS {
            if best.distance_m <= REACHED_M {
                break;
            }
            let other = self.descend(point, self.spread(index));
            if other.distance_m < best.distance_m {
                best = other;
            }
        }
        best
    }

    /// Descends from a posture to a local minimum of the distance.
    fn descend(&self, point: &Vector3<f64>, start: JointVector) -> Reach {
        let mut q = start;
        let mut kin = self.kinematics(&q);
        let mut error = point - kin.tip_position();
        let mut damping = DAMPING;
        for _ in 0..STEPS {
            if error.norm() <= REACHED_M || damping > LARGEST_DAMPING {
                break;
            }
            let columns = self.free_columns(&self.jacobian(&kin).linear, &q, &error);
            let mut square: Matrix3<f64> = Matrix3::zeros();
            columns.iter().for_each(|column| square += column * column.transpose());
            let scale = square.trace() / 3.0;
            let damped = square + Matrix3::identity() * (damping * scale).max(f64::MIN_POSITIVE);
            let Some(inverse) = damped.try_inverse() else { break };
            let along = inverse * error;
            let mut step = [0.0; MAX_JOINTS];
            for (value, column) in step.iter_mut().zip(&columns) {
                *value = column.dot(&along);
            }
            let next = self.within_limits(&std::array::from_fn::<f64, MAX_JOINTS, _>(|i| q[i] + step[i]));
            let next_kin = self.kinematics(&next);
            let next_error = point - next_kin.tip_position();
            let gain = error.norm() - next_error.norm();
            if gain > 0.0 {
                (q, kin, error) = (next, next_kin, next_error);
                damping *= 0.2;
                if gain < LEAST_GAIN_M {
                    break;
                }
            } else {
                damping = (damping * 8.0).max(DAMPING);
            }
        }
        Reach { q, position: kin.tip_position(), distance_m: error.norm() }
    }

    /// Columns of the Jacobian, zero for a joint at a limit that the error would push further.
    fn free_columns(
        &self,
        linear: &[Vector3<f64>; MAX_JOINTS],
        q: &JointVector,
        error: &Vector3<f64>,
    ) -> [Vector3<f64>; MAX_JOINTS] {
        let mut columns = [Vector3::zeros(); MAX_JOINTS];
        for (i, joint) in self.joints().iter().enumerate() {
            let push = linear[i].dot(error);
            let held = (q[i] <= joint.lower && push < 0.0) || (q[i] >= joint.upper && push > 0.0);
            if !held {
                columns[i] = linear[i];
            }
        }
        columns
    }

    /// Posture with every joint moved to its nearest allowed position.
    fn within_limits(&self, q: &[f64]) -> JointVector {
        let mut limited = [0.0; MAX_JOINTS];
        for ((value, joint), wanted) in limited.iter_mut().zip(self.joints()).zip(q) {
            *value = wanted.clamp(joint.lower, joint.upper);
        }
        limited
    }

    /// Posture `index` of a sequence that fills the joint ranges evenly (additive recurrence, R-sequence).
    fn spread(&self, index: usize) -> JointVector {
        let dof = self.dof();
        // Root of x^(d+1) = x + 1: the generalised golden ratio.
        let ratio = (0..32).fold(1.5_f64, |x, _| (1.0 + x).powf(1.0 / (dof as f64 + 1.0)));
        let mut q = [0.0; MAX_JOINTS];
        for (i, (value, joint)) in q.iter_mut().zip(self.joints()).enumerate() {
            let share = (0.5 + index as f64 * ratio.powi(-(i as i32 + 1))).fract();
            let (lower, upper) = if joint.lower.is_finite() { (joint.lower, joint.upper) } else { (-UNLIMITED, UNLIMITED) };
            *value = lower + share * (upper - lower);
        }
        q
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Arm of two links of 0.3 m in the x-z plane, and a rotation about z at the base.
    fn arm(limit: f64) -> Chain {
        let joint = |name: &str, parent: &str, child: &str, axis: &str, x: f64, limit: f64| {
            format!(
                "<joint name='{name}' type='revolute'><parent link='{parent}'/><child link='{child}'/><origin xyz='{x} 0 0'/>\
                 <axis xyz='{axis}'/><limit lower='-{limit}' upper='{limit}' effort='10' velocity='1'/></joint>"
            )
        };
        let link = |name: &str| {
            format!(
                "<link name='{name}'><inertial><mass value='1'/><inertia ixx='0.01' iyy='0.01' izz='0.01' ixy='0' ixz='0' \
                 iyz='0'/></inertial></link>"
            )
        };
        let text = format!(
            "<robot name='arm'><link name='base'/>{}{}{}<link name='tip'/>{}{}{}\
             <joint name='end' type='fixed'><parent link='c'/><child link='tip'/><origin xyz='0.3 0 0'/></joint></robot>",
            link("a"),
            link("b"),
            link("c"),
            joint("yaw", "base", "a", "0 0 1", 0.0, 3.1),
            joint("shoulder", "a", "b", "0 1 0", 0.0, 1.5),
            joint("elbow", "b", "c", "0 1 0", 0.3, limit),
        );
        Chain::from_urdf(&text, "arm.urdf", "base", "tip").unwrap()
    }

    #[test]
    fn reach_points_of_postures_are_reached() {
        let chain = arm(2.5);
        for index in 1..200 {
            let q = chain.spread(index);
            let point = chain.kinematics(&q).tip_position();
            let reach = chain.reach(&point, &[0.1, 0.2, 0.3]);
            assert!(reach.distance_m <= 1e-5, "{q:?}: {reach:?}");
            assert!((chain.kinematics(&reach.q).tip_position() - point).norm() <= 1e-5);
        }
    }

    #[test]
    fn reach_point_too_far_stretches_arm() {
        let chain = arm(2.5);
        let reach = chain.reach(&Vector3::new(1.0, 0.0, 0.0), &[0.0, 0.5, 0.5]);
        assert!((reach.distance_m - 0.4).abs() < 1e-3, "{reach:?}");
        assert!((reach.position - Vector3::new(0.6, 0.0, 0.0)).norm() < 1e-2, "{reach:?}");
    }

    #[test]
    fn reach_limits_are_kept() {
        // The elbow bends by 0.5 rad at most: no point is nearer to the shoulder than 0.58 m.
        let chain = arm(0.5);
        let reach = chain.reach(&Vector3::new(0.3, 0.0, 0.0), &[0.0, 0.0, 0.0]);
        let nearest = 0.6 * (0.25_f64).cos();
        assert!((reach.distance_m - (nearest - 0.3)).abs() < 2e-3, "{reach:?}");
        for (joint, q) in chain.joints().iter().zip(reach.q) {
            assert!((joint.lower..=joint.upper).contains(&q), "{reach:?}");
        }
    }

    #[test]
    fn reach_is_deterministic() {
        let chain = arm(2.5);
        let point = Vector3::new(0.1, 0.2, 0.3);
        assert_eq!(chain.reach(&point, &[0.0; 3]), chain.reach(&point, &[0.0; 3]));
    }

    #[test]
    fn spread_fills_ranges() {
        let chain = arm(2.5);
        for (i, joint) in chain.joints().iter().enumerate() {
            let values: Vec<f64> = (1..=STARTS).map(|index| chain.spread(index)[i]).collect();
            let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
            assert!(low >= joint.lower && high <= joint.upper, "{values:?}");
            assert!(high - low > 0.7 * (joint.upper - joint.lower), "{values:?}");
        }
    }
}
