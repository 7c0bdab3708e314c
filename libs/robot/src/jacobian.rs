//! The geometric Jacobian of a point.

use crate::chain::MAX_JOINTS;
use nalgebra::Vector3;

/// Geometric Jacobian of a point of the chain, column by column, world frame.
///
/// Column i is the velocity of the point (linear) and of its body (angular) when joint i moves at 1 rad/s or 1 m/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jacobian<const W: usize = MAX_JOINTS> {
    /// Number of valid columns, [`crate::Chain::dof`]; the rest is zero.
    pub n: usize,
    /// Linear part J, 3xN [m/rad], or [1] for a prismatic joint.
    pub linear: [Vector3<f64>; W],
    /// Angular part, 3xN [1]; zero for a prismatic joint.
    pub angular: [Vector3<f64>; W],
}

impl<const W: usize> Jacobian<W> {
    /// `J^T F`: the generalised forces [N m or N] equivalent to a force F at the point [N].
    #[inline]
    #[must_use]
    pub fn linear_transpose_mul(&self, force: &Vector3<f64>) -> [f64; W] {
        transpose_mul(&self.linear, self.n, force)
    }

    /// The generalised forces [N m or N] equivalent to a moment on the point's body [N m].
    #[inline]
    #[must_use]
    pub fn angular_transpose_mul(&self, moment: &Vector3<f64>) -> [f64; W] {
        transpose_mul(&self.angular, self.n, moment)
    }

    /// `J q'`: the velocity of the point [m/s] from `n` joint velocities [rad/s or m/s].
    ///
    /// Panics if `qd` is shorter than `n`.
    #[inline]
    #[must_use]
    pub fn linear_mul(&self, qd: &[f64]) -> Vector3<f64> {
        mul(&self.linear, &qd[..self.n])
    }

    /// The angular velocity of the point's body [rad/s].
    ///
    /// Panics if `qd` is shorter than `n`.
    #[inline]
    #[must_use]
    pub fn angular_mul(&self, qd: &[f64]) -> Vector3<f64> {
        mul(&self.angular, &qd[..self.n])
    }
}

#[inline]
fn transpose_mul<const W: usize>(columns: &[Vector3<f64>; W], n: usize, vector: &Vector3<f64>) -> [f64; W] {
    let mut result = [0.0; W];
    for (value, column) in result.iter_mut().zip(columns).take(n) {
        *value = column.dot(vector);
    }
    result
}

#[inline]
fn mul<const W: usize>(columns: &[Vector3<f64>; W], rates: &[f64]) -> Vector3<f64> {
    let mut result: Vector3<f64> = Vector3::zeros();
    for (column, rate) in columns.iter().zip(rates) {
        result += column * *rate;
    }
    result
}
