//! Whether the mass matrix can be inverted everywhere.

use crate::chain::{Chain, MAX_JOINTS};
use crate::error::RobotError;
use nalgebra::DMatrix;

/// Smallest eigenvalue of the mass matrix, scaled to ones on its diagonal, at which it counts as singular.
const SMALLEST: f64 = 1e-10;
/// Postures that are tried.
const POSTURES: u32 = 64;
/// Range of a joint without limits, to each side [rad].
const FREE_RANGE: f64 = core::f64::consts::PI;

impl Chain {
    /// Checks that the mass matrix is positive definite over the range of the joints, at postures that fill it evenly.
    pub(crate) fn check_mass_matrix(&self, file: &str) -> Result<(), RobotError> {
        for index in 0..=POSTURES {
            let q = self.posture(index);
            let (smallest, joint) = self.smallest_eigenvalue(&q);
            if smallest.is_nan() || smallest <= SMALLEST {
                return Err(RobotError::Singular {
                    file: file.to_owned(),
                    posture: q[..self.dof()].to_vec(),
                    joint: self.joints.get(joint).map(|joint| joint.name.clone()).unwrap_or_default(),
                    smallest,
                });
            }
        }
        Ok(())
    }

    /// A posture of a sequence with low discrepancy: multiples of the square roots of primes, modulo 1.
    fn posture(&self, index: u32) -> [f64; MAX_JOINTS] {
        const PRIMES: [f64; MAX_JOINTS] = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0];
        let mut q = [0.0; MAX_JOINTS];
        for ((q, joint), prime) in q.iter_mut().zip(&self.joints).zip(PRIMES) {
            let share = (f64::from(index) * prime.sqrt() + 0.5).fract();
            let (lower, upper) = (joint.lower.max(-FREE_RANGE), joint.upper.min(FREE_RANGE));
            *q = lower + share * (upper - lower);
        }
        q
    }

    /// Smallest eigenvalue of the mass matrix, scaled to ones on its diagonal, and the joint that moves most in it.
    fn smallest_eigenvalue(&self, q: &[f64; MAX_JOINTS]) -> (f64, usize) {
        let n = self.dof();
        let mass = self.mass_matrix(&self.kinematics(q));
        if let Some(joint) = (0..n).find(|i| mass[(*i, *i)].is_nan() || mass[(*i, *i)] <= 0.0) {
            return (0.0, joint);
        }
        let scaled = DMatrix::from_fn(n, n, |i, j| mass[(i, j)] / (mass[(i, i)] * mass[(j, j)]).sqrt());
        let eigen = scaled.symmetric_eigen();
        let (index, smallest) = eigen.eigenvalues.argmin();
        (smallest, eigen.eigenvectors.column(index).iamax())
    }
}
