//! Motion of the tip alone: what a law in task space needs at every tick, without the rest of [`Kinematics`].
//!
//! [`Kinematics`]: crate::Kinematics

use crate::chain::{Chain, JointVector, MAX_JOINTS};
use nalgebra::Vector3;

/// Position and linear Jacobian of the tip frame at one joint position, world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tip {
    /// Position of the tip frame [m].
    pub position: Vector3<f64>,
    n: usize,
    /// Linear part of the Jacobian, column by column; zero beyond the chain's joints.
    columns: [Vector3<f64>; MAX_JOINTS],
}

impl Chain {
    /// Position and linear Jacobian of the tip at joint positions `q` [rad or m]. Limits are not applied.
    ///
    /// Panics if `q` is shorter than [`Chain::dof`]; ignores further values.
    #[inline]
    #[must_use]
    pub fn tip(&self, q: &[f64]) -> Tip {
        let mut columns = [Vector3::zeros(); MAX_JOINTS];
        let mut origins = [Vector3::zeros(); MAX_JOINTS];
        let (origin, rotation) = self.walk(q, |i, _, axis, origin, _| {
            columns[i] = axis;
            origins[i] = origin;
        });
        let position = origin + rotation * self.tip_position;
        for ((column, origin), body) in columns.iter_mut().zip(&origins).zip(&self.bodies) {
            if body.rotational {
                *column = column.cross(&(position - origin));
            }
        }
        Tip { position, n: self.bodies.len(), columns }
    }

    /// Torques that apply `force` [N] at the tip, world frame, at joint positions `q`: `J^T F`; with a gravity [m/s^2]
    /// also those that hold the robot's own weight, g(q) [N m or N].
    ///
    /// Panics if `q` is shorter than [`Chain::dof`]; ignores further values.
    #[inline]
    #[must_use]
    pub fn tip_force_torque(&self, q: &[f64], force: &Vector3<f64>, gravity: Option<&Vector3<f64>>) -> JointVector {
        let mut torque = self.tip(q).torque(force);
        if let Some(gravity) = gravity {
            let hold = self.gravity_torque(&self.kinematics(q), gravity);
            torque.iter_mut().zip(hold).for_each(|(torque, hold)| *torque += hold);
        }
        torque
    }
}

impl Tip {
    /// Velocity of the tip [m/s] from joint velocities [rad/s or m/s]: `J q'`.
    ///
    /// Panics if `qd` is shorter than the chain has joints.
    #[inline]
    #[must_use]
    pub fn velocity(&self, qd: &[f64]) -> Vector3<f64> {
        self.columns.iter().zip(&qd[..self.n]).fold(Vector3::zeros(), |sum, (column, rate)| sum + column * *rate)
    }

    /// Torques that apply a force at the tip [N]: `J^T F` [N m or N].
    #[inline]
    #[must_use]
    pub fn torque(&self, force: &Vector3<f64>) -> JointVector {
        core::array::from_fn(|i| if i < self.n { self.columns[i].dot(force) } else { 0.0 })
    }
}
