//! Generated robots with 1 to [`MAX_JOINTS`] joints.

use hapfic_robot::{Chain, MAX_JOINTS, RobotError};
use std::fmt::Write;

/// Returns a serial arm of revolute joints about x, y, z, y, z, ..., with links of 0.25 m and 1 kg.
///
/// # Errors
/// [`RobotError`] if `joints` is 0 or above [`MAX_JOINTS`].
pub fn arm(joints: usize) -> Result<Chain, RobotError> {
    Chain::from_urdf(&urdf(joints), "generated.urdf", "link0", "tip")
}

/// Returns the URDF of [`arm`].
#[must_use]
pub fn urdf(joints: usize) -> String {
    let mut text = String::from("<robot name=\"arm\"><link name=\"link0\"/>");
    for joint in 0..joints {
        let axis = ["1 0 0", "0 1 0", "0 0 1"][if joint == 0 { 0 } else { 2 - joint % 2 }];
        let above = if joint == 0 { 0.0 } else { -0.25 };
        // Writing to a String never fails.
        let _ = write!(
            text,
            "<joint name=\"joint{joint}\" type=\"revolute\"><parent link=\"link{joint}\"/><child link=\"link{child}\"/>\
             <origin xyz=\"0 0 {above}\"/><axis xyz=\"{axis}\"/><limit lower=\"-3\" upper=\"3\" effort=\"80\" velocity=\"20\"/></joint>\
             <link name=\"link{child}\"><inertial><origin xyz=\"0 0 -0.125\"/><mass value=\"1\"/>\
             <inertia ixx=\"0.0053\" iyy=\"0.0053\" izz=\"0.0002\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>",
            child = joint + 1
        );
    }
    let _ = write!(
        text,
        "<joint name=\"end\" type=\"fixed\"><parent link=\"link{joints}\"/><child link=\"tip\"/><origin xyz=\"0 0 -0.25\"/></joint>\
         <link name=\"tip\"/></robot>"
    );
    text
}

/// Returns joint positions away from any singularity [rad], and joint velocities [rad/s].
#[must_use]
pub fn posture(joints: usize, index: usize) -> ([f64; MAX_JOINTS], [f64; MAX_JOINTS]) {
    let (mut q, mut qd) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
    for i in 0..joints.min(MAX_JOINTS) {
        let phase = 0.7 * i as f64 + 0.1 * index as f64;
        (q[i], qd[i]) = (0.4 + phase.sin(), 2.0 * phase.cos());
    }
    (q, qd)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn arm_joint_count_sets_dof_and_reach() {
        for joints in 1..=MAX_JOINTS {
            let chain = arm(joints).unwrap();
            assert_eq!(chain.dof(), joints);
            let straight = chain.kinematics(&[0.0; MAX_JOINTS]).tip_position();
            assert!((straight.z + 0.25 * joints as f64).abs() < 1e-12, "{straight}");
        }
        assert!(arm(MAX_JOINTS + 1).is_err());
    }

    #[test]
    fn arm_mass_matrix_is_regular() {
        let chain = arm(6).unwrap();
        let (q, _) = posture(6, 3);
        let mass = chain.mass_matrix(&chain.kinematics(&q));
        assert!(mass.fixed_view::<6, 6>(0, 0).determinant() > 1e-9);
    }
}
