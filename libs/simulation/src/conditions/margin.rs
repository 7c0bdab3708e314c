//! Margin of stability at a posture.

use hapfic_messages::{MAX_JOINTS, Parameters};
use hapfic_robot::Chain;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Mode of the task's stiffness that is nearest to its limit.
#[derive(Clone, Debug, PartialEq)]
pub struct CriticalMode {
    /// `omega tau / (0.32 + 2.3 zeta)`; 1 is the limit of stability.
    pub margin: f64,
    /// Frequency [Hz].
    pub frequency_hz: f64,
    /// Modal damping ratio.
    pub zeta: f64,
    /// Motion of the tip in it: share of each axis of the task, x y z, then the turns about them, in the sum of the energies.
    pub shares: [f64; 6],
}

impl CriticalMode {
    /// The axis of the task that moves most in this mode.
    #[must_use]
    pub fn axis(&self) -> &'static str {
        const NAMES: [&str; 6] = ["x", "y", "z", "turn about x", "turn about y", "turn about z"];
        let most = self.shares.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
        most.map_or(NAMES[0], |(index, _)| NAMES[index])
    }
}

/// Largest `omega tau / (0.32 + 2.3 zeta)` of the modes of the task's stiffness at a posture; 1 is the limit of stability.
///
/// omega^2 are the eigenvalues of M^-1 J^T K J, tau is the delay of the torque [s], zeta the modal damping of the joints, and
/// of the controller times cos(omega tau), since it acts as late as the spring. The rule was found for this attractor from simulations of one mass and of the leg: without
/// damping it needs `omega tau <= 0.32`, a plain sampled spring `omega tau <= 2 zeta`. J has six rows in a pose task. `None`
/// if the mass matrix is not positive definite.
#[must_use]
pub fn stability_margin(chain: &Chain, joint_position: &[f64; MAX_JOINTS], p: &Parameters, tau_s: f64) -> Option<f64> {
    critical_mode(chain, joint_position, p, tau_s).map(|mode| mode.margin)
}

/// The mode with the largest margin of [`stability_margin`].
#[must_use]
pub fn critical_mode(chain: &Chain, joint_position: &[f64; MAX_JOINTS], p: &Parameters, tau_s: f64) -> Option<CriticalMode> {
    let n = chain.dof();
    let kin = chain.kinematics(&joint_position[..n]);
    let (mass, jacobian) = (chain.mass_matrix(&kin), chain.jacobian(&kin));
    let m = if p.is_pose() { 6 } else { 3 };
    let rows = DMatrix::from_fn(
        m,
        n,
        |row, column| {
            if row < 3 { jacobian.linear[column][row] } else { jacobian.angular[column][row - 3] }
        },
    );
    let r = &p.rotation;
    let gain = |axis: usize| if axis < 3 { p.stiffness[axis] } else { r.stiffness[axis - 3] };
    let damper = |axis: usize| if axis < 3 { p.damping * gain(axis).sqrt() } else { r.damping * gain(axis).sqrt() };
    let weigh =
        |weight: &dyn Fn(usize) -> f64| rows.transpose() * DMatrix::from_diagonal(&DVector::from_fn(m, |i, _| weight(i))) * &rows;
    let stiffness = weigh(&gain);
    let mut delayed = weigh(&damper);
    for i in 0..n {
        delayed[(i, i)] += p.joint_space.joint_damping;
    }
    let own = DMatrix::from_diagonal(&DVector::from_fn(n, |i, _| chain.joints()[i].damping));
    let lower = DMatrix::from_fn(n, n, |row, column| mass[(row, column)]).cholesky()?.l();
    let inverse = lower.try_inverse()?;
    let modes = SymmetricEigen::try_new(&inverse * stiffness * inverse.transpose(), 1e-12, 1000)?;
    let modal = |damping: &DMatrix<f64>| &inverse * damping * inverse.transpose();
    let (own, delayed) = (modal(&own), modal(&delayed));
    let all = modes.eigenvalues.iter().zip(modes.eigenvectors.column_iter()).map(|(square, mode)| {
        let omega = square.max(0.0).sqrt();
        let ratio =
            |modal: &DMatrix<f64>| if omega > 0.0 { (mode.transpose() * modal * mode)[(0, 0)] / (2.0 * omega) } else { 0.0 };
        // The controller's damping comes as late as its spring.
        let zeta = ratio(&own) + ratio(&delayed) * (omega * tau_s).cos().max(0.0);
        let motion = &rows * (inverse.transpose() * mode);
        let energies: [f64; 6] =
            core::array::from_fn(|axis| if axis < m { gain(axis) * motion[axis] * motion[axis] } else { 0.0 });
        let sum: f64 = energies.iter().sum();
        CriticalMode {
            margin: omega * tau_s / (0.32 + 2.3 * zeta),
            frequency_hz: omega / core::f64::consts::TAU,
            zeta,
            shares: energies.map(|energy| if sum > 0.0 { energy / sum } else { 0.0 }),
        }
    });
    all.max_by(|a, b| a.margin.total_cmp(&b.margin))
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
