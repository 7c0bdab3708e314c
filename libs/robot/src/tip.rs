//! Motion of the tip alone: what a law in task space needs at every tick, without the rest of [`Kinematics`].
//!
//! [`Kinematics`]: crate::Kinematics

use crate::chain::{Chain, MAX_JOINTS};
use nalgebra::{Matrix3, Vector3};

/// Pose and Jacobian of the tip frame at one joint position, world frame, in arrays of `W` entries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tip<const W: usize = MAX_JOINTS> {
    /// Position of the tip frame [m].
    pub position: Vector3<f64>,
    /// Orientation of the tip frame: a rotation matrix, tip to world.
    pub rotation: Matrix3<f64>,
    n: usize,
    /// Linear part of the Jacobian, column by column; zero beyond the chain's joints.
    linear: [Vector3<f64>; W],
    /// Angular part.
    angular: [Vector3<f64>; W],
}

impl Chain {
    /// Pose and Jacobian of the tip at joint positions `q` [rad or m]. Limits are not applied.
    ///
    /// Panics if `q` is shorter than [`Chain::dof`], or `W` is less; ignores further values.
    #[inline]
    #[must_use]
    pub fn tip<const W: usize>(&self, q: &[f64]) -> Tip<W> {
        let mut linear = [Vector3::zeros(); W];
        let mut angular = [Vector3::zeros(); W];
        let mut origins = [Vector3::zeros(); W];
        let (origin, rotation) = self.walk(q, |i, _, axis, origin, _| {
            linear[i] = axis;
            origins[i] = origin;
        });
        let position = origin + rotation * self.tip_position;
        for (i, body) in self.bodies.iter().enumerate() {
            if body.rotational {
                angular[i] = linear[i];
                linear[i] = linear[i].cross(&(position - origins[i]));
            }
        }
        Tip { position, rotation: rotation * self.tip_rotation, n: self.bodies.len(), linear, angular }
    }

    /// Torques that apply `force` [N] at the tip, world frame, at joint positions `q`: `J^T F`; with a gravity [m/s^2]
    /// also those that hold the robot's own weight, g(q) [N m or N].
    ///
    /// Panics if `q` is shorter than [`Chain::dof`]; ignores further values.
    #[inline]
    #[must_use]
    pub fn tip_force_torque<const W: usize>(&self, q: &[f64], force: &Vector3<f64>, gravity: Option<&Vector3<f64>>) -> [f64; W] {
        let mut torque = self.tip::<W>(q).torque(force);
        if let Some(gravity) = gravity {
            let hold = self.gravity_torque(&self.kinematics_within::<W>(q), gravity);
            torque.iter_mut().zip(hold).for_each(|(torque, hold)| *torque += hold);
        }
        torque
    }
}

impl<const W: usize> Tip<W> {
    /// Velocity of the tip [m/s] from joint velocities [rad/s or m/s]: `J q'`.
    ///
    /// Panics if `qd` is shorter than the chain has joints.
    #[inline]
    #[must_use]
    pub fn velocity(&self, qd: &[f64]) -> Vector3<f64> {
        self.linear.iter().zip(&qd[..self.n]).fold(Vector3::zeros(), |sum, (column, rate)| sum + column * *rate)
    }

    /// Angular velocity of the tip [rad/s] from joint velocities [rad/s or m/s].
    ///
    /// Panics if `qd` is shorter than the chain has joints.
    #[inline]
    #[must_use]
    pub fn angular_velocity(&self, qd: &[f64]) -> Vector3<f64> {
        self.angular.iter().zip(&qd[..self.n]).fold(Vector3::zeros(), |sum, (axis, rate)| sum + axis * *rate)
    }

    /// Torques that apply a force at the tip [N]: `J^T F` [N m or N].
    #[inline]
    #[must_use]
    pub fn torque(&self, force: &Vector3<f64>) -> [f64; W] {
        core::array::from_fn(|i| if i < self.n { self.linear[i].dot(force) } else { 0.0 })
    }
}
