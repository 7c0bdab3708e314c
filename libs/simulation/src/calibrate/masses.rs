//! Effective masses of a robot's tip: what a force on an axis accelerates.

use hapfic_robot::{Chain, JointVector};
use nalgebra::{DMatrix, Matrix3, SymmetricEigen};

/// Effective masses and inertias of the tip, each with all other directions free to move.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EffectiveMasses {
    /// Along x, y and z [kg].
    pub axes_kg: [f64; 3],
    /// About x, y and z [kg m^2].
    pub axes_kg_m2: [f64; 3],
    /// Smallest one in any direction [kg].
    pub least_kg: f64,
    /// Smallest one about any axis [kg m^2].
    pub least_kg_m2: f64,
    /// Largest one in any direction in which the tip moves freely [kg].
    pub most_kg: f64,
    /// Largest one about any such axis [kg m^2].
    pub most_kg_m2: f64,
}

/// Mobility of a direction over the largest one, below which the tip does not count as free there: near a singularity.
const HELD: f64 = 1e-2;

impl EffectiveMasses {
    /// The smaller of two, one by one.
    #[must_use]
    pub fn smaller(&self, other: &Self) -> Self {
        Self {
            axes_kg: core::array::from_fn(|i| self.axes_kg[i].min(other.axes_kg[i])),
            axes_kg_m2: core::array::from_fn(|i| self.axes_kg_m2[i].min(other.axes_kg_m2[i])),
            least_kg: self.least_kg.min(other.least_kg),
            least_kg_m2: self.least_kg_m2.min(other.least_kg_m2),
            most_kg: self.most_kg.min(other.most_kg),
            most_kg_m2: self.most_kg_m2.min(other.most_kg_m2),
        }
    }
}

/// Effective masses at a posture: the inverses of `J M^-1 J^T`, of its diagonal and of its largest eigenvalue. `None` if the
/// mass matrix is not positive definite. A direction in which the tip cannot move has an infinite mass.
#[must_use]
pub fn effective_masses(chain: &Chain, q: &JointVector) -> Option<EffectiveMasses> {
    let n = chain.dof();
    let kin = chain.kinematics(q);
    let (mass, jacobian) = (chain.mass_matrix(&kin), chain.jacobian(&kin));
    let inverse = DMatrix::from_fn(n, n, |i, j| mass[(i, j)]).cholesky()?.inverse();
    let mobility = |columns: &[nalgebra::Vector3<f64>]| {
        let mut sum: Matrix3<f64> = Matrix3::zeros();
        for i in 0..n {
            for j in 0..n {
                sum += columns[i] * columns[j].transpose() * inverse[(i, j)];
            }
        }
        sum
    };
    let (linear, angular) = (mobility(&jacobian.linear), mobility(&jacobian.angular));
    let extremes = |m: &Matrix3<f64>| {
        let all = SymmetricEigen::new(*m).eigenvalues;
        let largest = all.max();
        let smallest = all.iter().copied().filter(|mobility| *mobility > HELD * largest).fold(largest, f64::min);
        (1.0 / largest, 1.0 / smallest)
    };
    let ((least_kg, most_kg), (least_kg_m2, most_kg_m2)) = (extremes(&linear), extremes(&angular));
    Some(EffectiveMasses {
        axes_kg: core::array::from_fn(|i| 1.0 / linear[(i, i)]),
        axes_kg_m2: core::array::from_fn(|i| 1.0 / angular[(i, i)]),
        least_kg,
        least_kg_m2,
        most_kg,
        most_kg_m2,
    })
}
