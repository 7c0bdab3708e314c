//! Whether the mass matrix can be inverted everywhere.

use crate::chain::{Chain, MAX_JOINTS};
use crate::error::RobotError;
use nalgebra::DMatrix;

/// Smallest eigenvalue of the mass matrix, scaled to ones on its diagonal, at which it counts as singular.
const SMALLEST: f64 = 1e-10;
/// Postures that are tried.
const POSTURES: u32 = 64;
/// Range that is tried of a joint with wider limits, or none, to each side [rad or m].
const RANGE: f64 = core::f64::consts::PI;

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

    /// A posture within the limits, of a sequence with low discrepancy that fills their range: multiples of the square roots of primes, modulo 1.
    #[must_use]
    pub fn posture(&self, index: u32) -> [f64; MAX_JOINTS] {
        const PRIMES: [f64; MAX_JOINTS] =
            [2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0, 29.0, 31.0, 37.0, 41.0, 43.0, 47.0, 53.0];
        let mut q = [0.0; MAX_JOINTS];
        for ((q, joint), prime) in q.iter_mut().zip(&self.joints).zip(PRIMES) {
            let share = (f64::from(index) * prime.sqrt() + 0.5).fract();
            let lower = joint.lower.max(-RANGE).min(joint.upper);
            *q = lower + share * (joint.upper - lower).min(2.0 * RANGE);
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

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn posture_any_limits_within_them() {
        let all =
            [("-0.5", "0.25"), ("4", "5"), ("-5", "-4"), ("-6.3", "6.3"), ("-1e16", "1e16"), ("0", "0"), ("-1e16", "-3e15")];
        for (lower, upper) in all {
            let text = format!(
                r#"<robot name="r"><link name="a"/><joint name="j" type="revolute"><parent link="a"/><child link="b"/>
                <limit lower="{lower}" upper="{upper}" effort="1"/></joint><link name="b"><inertial><mass value="1"/>
                <inertia ixx="1" iyy="1" izz="1"/></inertial></link></robot>"#
            );
            let chain = Chain::from_urdf(&text, "r.urdf", "a", "b").unwrap();
            let tried: Vec<f64> = (0..=POSTURES).map(|index| chain.posture(index)[0]).collect();
            let joint = &chain.joints()[0];
            assert!(tried.iter().all(|q| (joint.lower..=joint.upper).contains(q)), "{lower} to {upper}: {tried:?}");
        }
    }
}
