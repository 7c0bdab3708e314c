//! Check of a request's torque against its own wrench: `tau = J^T W + tau_N`, plus g where gravity is compensated, all at
//! the predicted posture.
//!
//! The gate knows state(k), so it can recompute the controller's torque, and with its own model tau_N, which is bounded by a
//! share of the joints' effort. It rejects a request whose numbers went wrong after the control law, as it rejects NaN: by a
//! bit flip, another robot's description, or a programming error in an external controller.
//!
//! What this cannot find: a wrench that is wrong itself, since force and moment are the controller's word; an error in the
//! description or in the code that both processes share; a state that is wrong. The peak and the rate limit bound those.

use hapfic_controller::joint_space::requested_torque;
use hapfic_messages::{MAX_JOINTS, Parameters, Request, State, ValidationError};
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

    /// Compares a request's torques with those of its wrench, in the state that it answers.
    ///
    /// # Errors
    /// [`ValidationError::Torque`] or [`ValidationError::JointSpaceTorque`] naming the first joint that differs; [`ValidationError::Count`] if the state is
    /// another robot's.
    pub fn check(&self, state: &State, request: &Request, parameters: &Parameters) -> Result<(), ValidationError> {
        let n = self.chain.dof();
        if state.joints as usize != n {
            return Err(ValidationError::Count { field: "joints", found: state.joints.into(), expected: n as u64 });
        }
        let (force, moment) = (Vector3::from(request.force), Vector3::from(request.rotation.moment));
        let own = requested_torque(&self.chain, &self.gravity, state, parameters, &force, &moment);
        let differs = |found: &[f64; MAX_JOINTS], expected: &[f64; MAX_JOINTS]| {
            (0..n).find(|&i| {
                let apart = (found[i] - expected[i]).abs();
                // A NaN on either side also differs.
                apart.is_nan() || apart > TOLERANCE * (1.0 + expected[i].abs())
            })
        };
        if let Some(joint) = differs(&request.joint_space_torque, &own.joint_space) {
            let (found, expected) = (request.joint_space_torque[joint], own.joint_space[joint]);
            return Err(ValidationError::JointSpaceTorque { joint, found, expected });
        }
        match differs(&request.torque, &own.total) {
            Some(joint) => Err(ValidationError::Torque { joint, found: request.torque[joint], expected: own.total[joint] }),
            None => Ok(()),
        }
    }
}
