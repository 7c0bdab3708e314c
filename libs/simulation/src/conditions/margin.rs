//! Margin of stability at a posture.

use hapfic_messages::{MAX_JOINTS, Parameters};
use hapfic_robot::Chain;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Largest `omega tau / (0.32 + 2.3 zeta)` of the modes of K0 at a posture; 1 is the limit of stability.
///
/// omega^2 are the eigenvalues of M^-1 J^T K0 J, zeta the modal damping of joint damping and Cartesian damping, tau the
/// delay of the torque [s]. The rule was found for this attractor from simulations of one mass and of the leg: without
/// damping it needs `omega tau <= 0.32`, a plain sampled spring `omega tau <= 2 zeta`. `None` if the mass matrix is not
/// positive definite.
#[must_use]
pub fn stability_margin(chain: &Chain, joint_position: &[f64; MAX_JOINTS], p: &Parameters, tau_s: f64) -> Option<f64> {
    let n = chain.dof();
    let kin = chain.kinematics(&joint_position[..n]);
    let (mass, jacobian) = (chain.mass_matrix(&kin), chain.jacobian(&kin));
    let rows = DMatrix::from_fn(3, n, |row, column| jacobian.linear[column][row]);
    let weigh = |weights: [f64; 3]| rows.transpose() * DMatrix::from_diagonal(&DVector::from_row_slice(&weights)) * &rows;
    let stiffness = weigh(p.stiffness);
    let mut damping = weigh(p.stiffness.map(|k0| p.damping * k0.sqrt()));
    for (i, joint) in chain.joints().iter().enumerate() {
        damping[(i, i)] += joint.damping;
    }
    let lower = DMatrix::from_fn(n, n, |row, column| mass[(row, column)]).cholesky()?.l();
    let inverse = lower.try_inverse()?;
    let modes = SymmetricEigen::try_new(&inverse * stiffness * inverse.transpose(), 1e-12, 1000)?;
    let modal = &inverse * damping * inverse.transpose();
    let margins = modes.eigenvalues.iter().zip(modes.eigenvectors.column_iter()).map(|(square, mode)| {
        let omega = square.max(0.0).sqrt();
        let zeta = if omega > 0.0 { (mode.transpose() * &modal * mode)[(0, 0)] / (2.0 * omega) } else { 0.0 };
        omega * tau_s / (0.32 + 2.3 * zeta)
    });
    margins.fold(None, |most: Option<f64>, margin| Some(most.map_or(margin, |most| most.max(margin))))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_config::Settings;

    fn margin(overrides: &[&str], tau_s: f64) -> f64 {
        let overrides: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
        let settings = Settings::load("floor", &overrides).unwrap();
        let chain = Chain::from_settings(&settings.robot).unwrap();
        let p = hapfic_controller::parameters::parameters(
            &settings.initial,
            1,
            0,
            &hapfic_controller::parameters::TipPose::default(),
        );
        let mut q = [0.0; MAX_JOINTS];
        q[..3].copy_from_slice(&[0.0, 0.9, -1.8]);
        stability_margin(&chain, &q, &p, tau_s).unwrap()
    }

    #[test]
    fn margin_of_paper_gains_matches_its_known_modes() {
        // omega^2 max = 29 300 1/s^2 at this posture without damping.
        let undamped = margin(&["controller.damping_sqrt_kg=0"], 1.5e-3);
        assert!((undamped - 29_300.0_f64.sqrt() * 1.5e-3 / 0.32).abs() < 0.01, "{undamped}");
        assert!(margin(&[], 1.5e-3) < 0.5);
        assert!(margin(&["controller.damping_sqrt_kg=0"], 2.5e-3) > 1.0);
        assert!(margin(&["controller.stiffness=[20000, 20000, 40000]", "controller.damping_sqrt_kg=0"], 1.5e-3) > 1.4);
    }
}
