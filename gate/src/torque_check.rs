//! Check of a request's torque against its own force: tau = J^T F_c, plus g where gravity is compensated, both at
//! the predicted posture.
//!
//! The gate knows state(k), so it can recompute the controller's torque. It rejects a request whose numbers went wrong
//! after the control law, as it rejects NaN: by a bit flip, another robot's description, or a programming error in an
//! external controller.

use hapfic_messages::{Parameters, Request, State, ValidationError};
use hapfic_robot::Chain;
use nalgebra::Vector3;

/// Accepted difference, relative to 1 N m plus the torque: another program may round differently.
const TOLERANCE: f64 = 1e-6;

/// Torque check with the gate's model of the robot.
#[derive(Clone, Debug)]
pub struct TorqueCheck {
    chain: Chain,
    gravity: Vector3<f64>,
}

impl TorqueCheck {
    /// Check for a robot, and for gravity in the world frame [m/s^2].
    #[must_use]
    pub fn new(chain: Chain, gravity: [f64; 3]) -> Self {
        Self { chain, gravity: gravity.into() }
    }

    /// Compares a request's torque with that of its force, in the state that it answers.
    ///
    /// # Errors
    /// [`ValidationError::Torque`] naming the first joint that differs; [`ValidationError::Count`] if the state is
    /// another robot's.
    pub fn check(&self, state: &State, request: &Request, parameters: &Parameters) -> Result<(), ValidationError> {
        let n = self.chain.dof();
        if state.joints as usize != n {
            return Err(ValidationError::Count { field: "joints", found: state.joints.into(), expected: n as u64 });
        }
        let gravity = (parameters.gravity_compensation == 1).then_some(&self.gravity);
        let ahead = parameters.predicted_posture(state);
        let expected = self.chain.tip_force_torque(&ahead, &Vector3::from(request.force), gravity);
        let differs = |i: &usize| {
            let (found, expected) = (request.torque[*i], expected[*i]);
            let apart = (found - expected).abs();
            // A NaN on either side also differs.
            apart.is_nan() || apart > TOLERANCE * (1.0 + expected.abs())
        };
        match (0..n).find(differs) {
            Some(joint) => Err(ValidationError::Torque { joint, found: request.torque[joint], expected: expected[joint] }),
            None => Ok(()),
        }
    }
}
