//! Dynamically consistent null space of the task: torques that move the joints and leave the tip alone.
//!
//! With the mass matrix M and the task's Jacobian J, `N^T = I - J^T (J M^-1 J^T)^-1 J M^-1`: a torque `N^T tau` gives the tip
//! no acceleration (Khatib 1987, eq. 26). Near a singularity J M^-1 J^T is damped by a small multiple of the identity.

use crate::chain::{Chain, JointVector, MAX_JOINTS};
use crate::cholesky::{factor, substitute};
use crate::dynamics::MassMatrix;
use crate::jacobian::Jacobian;

/// Damping of `J M^-1 J^T` in the null space's inverse, over its trace: small errors of the task stay small, and near a
/// singularity nothing grows beyond bounds.
const DAMPING: f64 = 1e-6;

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
    pub fn null_space_torque(&self, mass: &MassMatrix, jacobian: &Jacobian, rows: TaskRows, tau: &JointVector) -> JointVector {
        let (n, m) = (self.dof(), rows.count());
        let none = [0.0; MAX_JOINTS];
        // Symmetric: columns equal rows.
        let mut root: [JointVector; MAX_JOINTS] = (*mass).into();
        if n <= m || !factor(&mut root, n) {
            return none;
        }
        let row = |k: usize| -> JointVector {
            core::array::from_fn(|i| if k < 3 { jacobian.linear[i][k] } else { jacobian.angular[i][k - 3] })
        };
        let j: [JointVector; 6] = core::array::from_fn(|k| if k < m { row(k) } else { none });
        let mut spread = j;
        for column in &mut spread[..m] {
            substitute(&root, column, n);
        }
        let dot = |a: &JointVector, b: &JointVector| -> f64 { a[..n].iter().zip(&b[..n]).map(|(a, b)| a * b).sum() };
        let mut mobility = [[0.0; 6]; 6];
        for a in 0..m {
            for b in 0..=a {
                mobility[a][b] = dot(&j[a], &spread[b]);
            }
        }
        // Translation and rotation have other units: each is damped by its own part of the trace.
        for first in (0..m).step_by(3) {
            let trace: f64 = (first..first + 3).map(|k| mobility[k][k]).sum();
            mobility.iter_mut().enumerate().skip(first).take(3).for_each(|(k, row)| row[k] += DAMPING * trace);
        }
        let mut held: [f64; 6] = core::array::from_fn(|k| dot(&spread[k], tau));
        if !factor(&mut mobility, m) {
            return none;
        }
        substitute(&mobility, &mut held, m);
        let mut out = none;
        for i in 0..n {
            out[i] = tau[i] - (0..m).map(|k| j[k][i] * held[k]).sum::<f64>();
        }
        out
    }
}
