//! Control step of one tick: from the inputs of tick k to request(k), without a clock or a bus.

use crate::task_space::{self, TaskSpaceInput};
use hapfic_config::PERIOD_S;
use hapfic_messages::{ControllerState, Parameters, Process, Request, State};
use hapfic_robot::Chain;
use nalgebra::Vector3;

/// Inputs of a control step.
#[derive(Clone, Copy, Debug)]
pub struct ControlInputs<'a> {
    /// state(k).
    pub state: &'a State,
    /// x_d of reference(k) [m].
    pub reference_position: [f64; 3],
    /// x_d' of reference(k) [m/s].
    pub reference_velocity: [f64; 3],
    /// Parameters of tick k.
    pub parameters: &'a Parameters,
    /// State of the controller in command(k - 1).
    pub previous_state: ControllerState,
}

/// Runs one tick of the control law, a pure function of its inputs.
///
/// Returns `None` if the state has another number of joints than the robot, or an input is not finite. `gravity` is in
/// the world frame [m/s^2]. The request carries the code of `controller` and a `stamp_ns` of zero.
#[must_use]
pub fn control_step(chain: &Chain, gravity: &Vector3<f64>, inputs: &ControlInputs<'_>, controller: Process) -> Option<Request> {
    let ControlInputs { state, parameters, .. } = *inputs;
    let n = chain.dof();
    if state.joints as usize != n {
        return None;
    }
    let tip = chain.tip(&state.joint_position);
    let measured = TaskSpaceInput {
        position: tip.position.into(),
        velocity: tip.velocity(&state.joint_velocity).into(),
        reference_position: inputs.reference_position,
        reference_velocity: inputs.reference_velocity,
        contact_force: state.foot_force,
    };
    let out = task_space::step(inputs.previous_state, &measured, parameters, PERIOD_S).ok()?;
    // The torque acts later than its state: J^T of the posture that the robot has then.
    let ahead = parameters.predicted_posture(state);
    let gravity = (parameters.gravity_compensation == 1).then_some(gravity);
    let torque = chain.tip_force_torque(&ahead, &Vector3::from(out.force), gravity);
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
