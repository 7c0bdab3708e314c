//! Robots with any number of joints.

use hapfic_robot::{Chain, MAX_JOINTS, RobotError};
use std::fmt::Write;

/// Most joints there can be.
pub const MOST: usize = MAX_JOINTS;

/// A serial arm of `joints` revolute joints about x, y, z, y, z, ... in turn, 0.25 m and 1 kg between two of them.
///
/// # Errors
/// [`RobotError`] if there are none or more than [`MOST`].
pub fn arm(joints: usize) -> Result<Chain, RobotError> {
    Chain::from_urdf(&urdf(joints), "generated.urdf", "link0", "tip")
}

/// Its description.
#[must_use]
pub fn urdf(joints: usize) -> String {
    let mut text = String::from("<robot name=\"arm\"><link name=\"link0\"/>");
    for joint in 0..joints {
        let axis = ["1 0 0", "0 1 0", "0 0 1"][if joint == 0 { 0 } else { 2 - joint % 2 }];
        let above = if joint == 0 { 0.0 } else { -0.25 };
        // A String takes everything.
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

/// A posture away from any singularity, and velocities, rad/s.
#[must_use]
pub fn posture(joints: usize, turn: usize) -> ([f64; MOST], [f64; MOST]) {
    let (mut q, mut qd) = ([0.0; MOST], [0.0; MOST]);
    for i in 0..joints.min(MOST) {
        let phase = 0.7 * i as f64 + 0.1 * turn as f64;
        (q[i], qd[i]) = (0.4 + phase.sin(), 2.0 * phase.cos());
    }
    (q, qd)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn arms_have_as_many_joints_as_asked_for_and_reach_as_far() {
        for joints in 1..=MOST {
            let chain = arm(joints).unwrap();
            assert_eq!(chain.dof(), joints);
            let straight = chain.kinematics(&[0.0; MOST]).tip_position();
            assert!((straight.z + 0.25 * joints as f64).abs() < 1e-12, "{straight}");
        }
        assert!(arm(MOST + 1).is_err());
    }

    #[test]
    fn their_mass_matrix_is_regular() {
        let chain = arm(6).unwrap();
        let (q, _) = posture(6, 3);
        let mass = chain.mass_matrix(&chain.kinematics(&q));
        assert!(mass.fixed_view::<6, 6>(0, 0).determinant() > 1e-9);
    }
}
