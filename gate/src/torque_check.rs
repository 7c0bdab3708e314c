//! Whether a request's torque is what its own force asks for: tau = J(q)^T F_c, and g(q) on top where gravity is compensated.
//!
//! The gate knows state(k), so it can recompute what the controller should have. A controller whose numbers went wrong after its
//! law (a bit flip, another robot's description, a programming error in a foreign one) is rejected here, like one that sends NaN.

use hapfic_messages::{MAX_JOINTS, Parameters, Request, State, ValidationError};
use hapfic_robot::Chain;
use nalgebra::Vector3;

/// Difference that passes, relative to 1 N m plus the torque: another program may round otherwise.
const TOLERANCE: f64 = 1e-6;

/// The robot as the gate knows it.
#[derive(Clone, Debug)]
pub struct TorqueCheck {
    chain: Chain,
    gravity: Vector3<f64>,
}

impl TorqueCheck {
    /// For a robot, and gravity in m/s^2, world frame.
    #[must_use]
    pub fn new(chain: Chain, gravity: [f64; 3]) -> Self {
        Self { chain, gravity: gravity.into() }
    }

    /// Compares a request's torque with that of its force, in the state it answers.
    ///
    /// # Errors
    /// [`ValidationError::Torque`] naming the first joint that differs; [`ValidationError::Count`] if the state is another robot's.
    pub fn check(&self, state: &State, request: &Request, parameters: &Parameters) -> Result<(), ValidationError> {
        let n = self.chain.dof();
        if state.joints as usize != n {
            return Err(ValidationError::Count { field: "joints", found: state.joints.into(), expected: n as u64 });
        }
        let kin = self.chain.kinematics(&state.joint_position[..n]);
        let jacobian = self.chain.jacobian(&kin);
        let mut expected = jacobian.linear_transpose_mul(&Vector3::from(request.force));
        if parameters.gravity_compensation == 1 {
            let hold = self.chain.gravity_torque(&kin, &self.gravity);
            for i in 0..MAX_JOINTS {
                expected[i] += hold[i];
            }
        }
        let differs = |i: &usize| {
            let (found, expected) = (request.torque[*i], expected[*i]);
            let apart = (found - expected).abs();
            // A NaN on either side differs, too.
            apart.is_nan() || apart > TOLERANCE * (1.0 + expected.abs())
        };
        match (0..n).find(differs) {
            Some(joint) => Err(ValidationError::Torque { joint, found: request.torque[joint], expected: expected[joint] }),
            None => Ok(()),
        }
    }
}
