//! Dynamically consistent null space of the task: torques that move the joints and leave the tip alone.
//!
//! With the mass matrix M and the task's Jacobian J, `N^T = I - J^T (J M^-1 J^T)^-1 J M^-1`: a torque `N^T tau` gives the tip
//! no acceleration (Khatib 1987, eq. 26). Near a singularity J M^-1 J^T is damped by a small multiple of the identity.

use crate::chain::Chain;
use crate::cholesky::{factor, substitute};
use crate::dynamics::MassMatrix;
use crate::jacobian::Jacobian;
use nalgebra::Vector3;

/// Damping of `J M^-1 J^T` in the null space's inverse, over its trace: small errors of the task stay small, and near a
/// singularity nothing grows beyond bounds.
const DAMPING: f64 = 1e-6;
/// Right-hand sides that are solved together: six rows of J, tau, and one that fills a vector register.
const COLUMNS: usize = 8;
/// Column of tau.
const TAU: usize = 6;

/// Rows of the Jacobian that a task has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TaskRows {
    /// Three: the position of the tip.
    Linear,
    /// Six: position and orientation.
    Both,
}

impl TaskRows {
    /// Number of rows.
    #[must_use]
    pub fn count(self) -> usize {
        match self {
            Self::Linear => 3,
            Self::Both => 6,
        }
    }
}

impl Chain {
    /// Returns `N^T tau`: the part of a torque that leaves the tip alone; zero if the robot has no joints beyond the task's.
    ///
    /// `mass` is the mass matrix of the posture, `jacobian` that of the tip. A posture whose mass matrix is singular gives
    /// zero, too.
    #[must_use]
    pub fn null_space_torque<const W: usize>(
        &self,
        mass: &MassMatrix<W>,
        jacobian: &Jacobian<W>,
        rows: TaskRows,
        tau: &[f64; W],
    ) -> [f64; W] {
        let (n, m) = (self.dof(), rows.count());
        let none = [0.0; W];
        // Symmetric: columns equal rows.
        let mut root: [[f64; W]; W] = (*mass).into();
        if n <= m || !factor(&mut root, n) {
            return none;
        }
        // With M = L L^T, each joint's row of L^-1 [J^T tau]: up to six columns of J^T, then tau.
        let mut half: [[f64; COLUMNS]; W] = core::array::from_fn(|i| {
            let (linear, angular) = (&jacobian.linear[i], if m == 6 { jacobian.angular[i] } else { Vector3::zeros() });
            [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z, tau[i], 0.0]
        });
        for (i, factors) in root.iter().enumerate().take(n) {
            let (above, rest) = half.split_at_mut(i);
            let row = &mut rest[0];
            for (entry, other) in factors.iter().zip(above) {
                row.iter_mut().zip(other).for_each(|(value, other)| *value -= entry * *other);
            }
            row.iter_mut().for_each(|value| *value *= factors[i]);
        }
        // J M^-1 J^T in the first m rows and columns, J M^-1 tau in the row of tau.
        let mut mobility = [[0.0; COLUMNS]; COLUMNS];
        for row in &half[..n] {
            for (sums, entry) in mobility.iter_mut().zip(row) {
                sums.iter_mut().zip(row).for_each(|(sum, other)| *sum += entry * other);
            }
        }
        // Translation and rotation have other units: each is damped by its own part of the trace.
        for first in (0..m).step_by(3) {
            let trace: f64 = (first..first + 3).map(|k| mobility[k][k]).sum();
            mobility.iter_mut().enumerate().skip(first).take(3).for_each(|(k, row)| row[k] += DAMPING * trace);
        }
        let mut held = mobility[TAU];
        if !factor(&mut mobility, m) {
            return none;
        }
        substitute(&mobility, &mut held, m);
        let force = Vector3::new(held[0], held[1], held[2]);
        let moment = if m == 6 { Vector3::new(held[3], held[4], held[5]) } else { Vector3::zeros() };
        core::array::from_fn(
            |i| {
                if i < n { tau[i] - jacobian.linear[i].dot(&force) - jacobian.angular[i].dot(&moment) } else { 0.0 }
            },
        )
    }
}
