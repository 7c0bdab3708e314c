//! Newton's method with the exact derivatives, for sub-steps that the quasi-Newton method does not solve.
//!
//! The quasi-Newton matrix leaves out how the normal force changes friction, and the falling branch of mu. Where a hard
//! contact passes from sticking to sliding, these terms outweigh the masses, and its iteration runs in a cycle. Here
//! the matrix has them. It is not symmetric, and a Gaussian elimination solves it.

use crate::newton::{ConstraintForce, Newton};
use crate::point::ConstraintPoint;
use crate::velocities::{MAX_SPEEDS, VelocityVector};

/// Maximum number of iterations.
const MAX_ITERATIONS: u32 = 40;
/// Shortest share of a step.
const MIN_SCALE: f64 = 1e-4;

/// Solves `m x = b` for the upper left `n` rows by Gaussian elimination with row pivots; `false` if `m` is singular.
///
/// Replaces `b` by the solution.
fn eliminate(m: &mut [VelocityVector; MAX_SPEEDS], b: &mut VelocityVector, n: usize) -> bool {
    for column in 0..n {
        let Some(pivot) = (column..n).max_by(|&i, &j| m[i][column].abs().total_cmp(&m[j][column].abs())) else { return false };
        if m[pivot][column] == 0.0 || !m[pivot][column].is_finite() {
            return false;
        }
        m.swap(column, pivot);
        b.swap(column, pivot);
        let (upper, lower) = m.split_at_mut(column + 1);
        let row = &upper[column];
        for (i, below) in lower[..n - column - 1].iter_mut().enumerate() {
            let share = below[column] / row[column];
            for j in column..n {
                below[j] -= share * row[j];
            }
            b[column + 1 + i] -= share * b[column];
        }
    }
    for i in (0..n).rev() {
        let known: f64 = (i + 1..n).map(|j| m[i][j] * b[j]).sum();
        b[i] = (b[i] - known) / m[i][i];
    }
    true
}

impl Newton {
    /// Continues from the velocities `v` until the residual is within `tolerance` [N s].
    ///
    /// Returns the number of iterations, and the last residual. `forces` are those at `v` before and after.
    pub(crate) fn solve_exactly(
        &mut self,
        h: f64,
        tolerance: f64,
        points: &[ConstraintPoint],
        v: &mut VelocityVector,
        forces: &mut [ConstraintForce],
    ) -> (u32, f64) {
        let n = self.n();
        let mut norm = self.evaluate(h, points, v, forces);
        let mut iterations = 0;
        while norm > tolerance && iterations < MAX_ITERATIONS {
            iterations += 1;
            self.assemble_exactly(h, points, v);
            let mut step = self.residual;
            if !eliminate(&mut self.matrix, &mut step, n) {
                break;
            }
            let (last, start) = (norm, *v);
            let mut scale = 1.0;
            loop {
                for ((v, start), step) in v.iter_mut().zip(&start).zip(&step).take(n) {
                    *v = start - scale * step;
                }
                norm = self.evaluate(h, points, v, forces);
                if norm < (1.0 - 0.1 * scale) * last || norm <= tolerance {
                    break;
                }
                scale *= 0.5;
                if scale < MIN_SCALE {
                    return (iterations, norm);
                }
            }
        }
        (iterations, norm)
    }

    /// Fills the whole matrix at velocities `v`.
    fn assemble_exactly(&mut self, h: f64, points: &[ConstraintPoint], v: &VelocityVector) {
        let n = self.n();
        self.assemble_masses();
        for i in 0..n {
            for j in 0..i {
                self.matrix[j][i] = self.matrix[i][j];
            }
        }
        for (point, before) in points.iter().zip(&self.before) {
            if let Some(slope) = point.exact_slope(h, *before, &point.speeds(v)) {
                point.add_exact_stiffness(&(slope * h), &mut self.matrix);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elimination_with_zero_on_diagonal_solves() {
        let (mut matrix, mut right) = ([[0.0; MAX_SPEEDS]; MAX_SPEEDS], [0.0; MAX_SPEEDS]);
        let rows = [[0.0, 2.0, 1.0], [4.0, 1.0, -1.0], [-2.0, 3.0, 0.5]];
        let solution = [0.3, -1.2, 2.0];
        for i in 0..3 {
            matrix[i][..3].copy_from_slice(&rows[i]);
            right[i] = (0..3).map(|j| rows[i][j] * solution[j]).sum();
        }
        assert!(eliminate(&mut matrix, &mut right, 3));
        for i in 0..3 {
            assert!((right[i] - solution[i]).abs() < 1e-14, "{right:?}");
        }
        assert!(!eliminate(&mut [[0.0; MAX_SPEEDS]; MAX_SPEEDS], &mut right, 2), "a singular matrix has no solution");
    }
}
