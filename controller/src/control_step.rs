//! The controller's answer to one tick: from what is known at tick k to request(k), without a clock or a bus.

use crate::task_space::{self, Input as Measured};
use hapfic_config::PERIOD_S;
use hapfic_messages::{ControllerState, MAX_JOINTS, Parameters, Process, Request, State};
use hapfic_robot::Chain;
use nalgebra::Vector3;

/// What a controller knows at a tick.
#[derive(Clone, Copy, Debug)]
pub struct ControlInputs<'a> {
    /// state(k).
    pub state: &'a State,
    /// x_d of reference(k), m.
    pub reference_position: [f64; 3],
    /// Its velocity, m/s.
    pub reference_velocity: [f64; 3],
    /// The parameters in force at tick k.
    pub parameters: &'a Parameters,
    /// The controller's state as command(k - 1) carries it.
    pub previous_state: ControllerState,
}

/// One tick of the control law: a pure function of what is known. `None` if that does not allow an answer: another number of
/// joints than the robot's, or numbers that are not finite.
///
/// `gravity` is in m/s^2, world frame; `controller` signs the request, whose `stamp_ns` is zero.
#[must_use]
pub fn control_step(chain: &Chain, gravity: &Vector3<f64>, known: &ControlInputs<'_>, controller: Process) -> Option<Request> {
    let ControlInputs { state, parameters, .. } = *known;
    let n = chain.dof();
    if state.joints as usize != n {
        return None;
    }
    let kin = chain.kinematics(&state.joint_position[..n]);
    let jacobian = chain.jacobian(&kin);
    let measured = Measured {
        position: kin.tip_position().into(),
        velocity: jacobian.linear_mul(&state.joint_velocity[..n]).into(),
        reference_position: known.reference_position,
        reference_velocity: known.reference_velocity,
        contact_force: state.foot_force,
    };
    let out = task_space::step(known.previous_state, &measured, parameters, PERIOD_S).ok()?;
    let mut torque = jacobian.linear_transpose_mul(&Vector3::from(out.force));
    if parameters.gravity_compensation == 1 {
        let hold = chain.gravity_torque(&kin, gravity);
        for i in 0..MAX_JOINTS {
            torque[i] += hold[i];
        }
    }
    Some(Request {
        stamp_ns: 0,
        tick: state.tick,
        state_tick: state.tick,
        parameters_version: parameters.version,
        controller: controller.code(),
        joints: n as u32,
        error: out.error,
        error_rate: out.error_rate,
        force: out.force,
        torque,
        state: out.state,
    })
}
