//! Control step of one tick: from the inputs of tick k to request(k), without a clock or a bus.

use crate::joint_space::{LONG, MIDDLE, SHORT, torque_within};
use crate::orientation::orientation_error;
use crate::task_space::{self, TaskSpaceInput};
use hapfic_config::PERIOD_S;
use hapfic_messages::{ControllerState, Parameters, Process, Reference, Request, RotationRequest, State};
use hapfic_robot::{Chain, Tip};
use nalgebra::Vector3;

/// Inputs of a control step.
#[derive(Clone, Copy, Debug)]
pub struct ControlInputs<'a> {
    /// state(k).
    pub state: &'a State,
    /// Setpoint of reference(k).
    pub setpoint: ReferenceSetpoint,
    /// Parameters of tick k.
    pub parameters: &'a Parameters,
    /// States of the controller in command(k - 1).
    pub previous: PreviousStates,
}

/// Reference of a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReferenceSetpoint {
    /// x_d [m].
    pub position: [f64; 3],
    /// x_d' [m/s].
    pub velocity: [f64; 3],
    /// R_d: unit quaternion x y z w; not read in a position task.
    pub orientation: [f64; 4],
    /// omega_d [rad/s].
    pub angular_velocity: [f64; 3],
}

/// What the law remembers from tick to tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PreviousStates {
    /// The axes of position.
    pub translation: ControllerState,
    /// The axes of rotation.
    pub rotation: ControllerState,
}

impl ReferenceSetpoint {
    /// The setpoint of a reference.
    #[must_use]
    pub fn of(reference: &Reference) -> Self {
        Self {
            position: reference.position,
            velocity: reference.velocity,
            orientation: reference.orientation,
            angular_velocity: reference.angular_velocity,
        }
    }

    /// At rest at the tip of a state.
    #[must_use]
    pub fn at_tip(state: &State) -> Self {
        Self { position: state.foot_position, orientation: state.foot_orientation, ..Self::default() }
    }

    /// The same pose, at rest.
    #[must_use]
    pub fn held(self) -> Self {
        Self { velocity: [0.0; 3], angular_velocity: [0.0; 3], ..self }
    }
}

impl PreviousStates {
    /// The states that a request carries.
    #[must_use]
    pub fn of(request: &Request) -> Self {
        Self { translation: request.state, rotation: request.rotation.state }
    }
}

/// Runs one tick of the control law, a pure function of its inputs.
///
/// Returns `None` if the state has another number of joints than the robot, or an input is not finite. `gravity` is in
/// the world frame [m/s^2]. The request carries the code of `controller` and a `stamp_ns` of zero.
#[must_use]
pub fn control_step(chain: &Chain, gravity: &Vector3<f64>, inputs: &ControlInputs<'_>, controller: Process) -> Option<Request> {
    match chain.dof() {
        n if n <= SHORT => step_within::<SHORT>(chain, gravity, inputs, controller),
        n if n <= MIDDLE => step_within::<MIDDLE>(chain, gravity, inputs, controller),
        _ => step_within::<LONG>(chain, gravity, inputs, controller),
    }
}

fn step_within<const W: usize>(
    chain: &Chain,
    gravity: &Vector3<f64>,
    inputs: &ControlInputs<'_>,
    controller: Process,
) -> Option<Request> {
    let ControlInputs { state, parameters, setpoint, previous } = *inputs;
    let n = chain.dof();
    if state.joints as usize != n {
        return None;
    }
    let tip = chain.tip::<W>(&state.joint_position);
    let measured = TaskSpaceInput {
        position: tip.position.into(),
        velocity: tip.velocity(&state.joint_velocity).into(),
        reference_position: setpoint.position,
        reference_velocity: setpoint.velocity,
        contact_force: state.foot_force,
    };
    let out = task_space::step(previous.translation, &measured, parameters, PERIOD_S).ok()?;
    let rotation = if parameters.is_pose() { turn(&tip, inputs)? } else { RotationRequest::default() };
    let (force, moment) = (Vector3::from(out.force), Vector3::from(rotation.moment));
    let torque = torque_within::<W>(chain, gravity, state, parameters, &force, &moment);
    Some(Request {
        stamp_ns: 0,
        tick: state.tick,
        state_tick: state.tick,
        parameters_version: parameters.version,
        controller: controller.code(),
        joints: n as u32,
        limbs: 1,
        reserved: 0,
        error: out.error,
        error_rate: out.error_rate,
        force: out.force,
        torque: torque.total,
        joint_space_torque: torque.joint_space,
        state: out.state,
        rotation,
    })
}

/// Runs the law on the axes of rotation: the same law on the rotation vector from the tip to its reference.
fn turn<const W: usize>(tip: &Tip<W>, inputs: &ControlInputs<'_>) -> Option<RotationRequest> {
    let ControlInputs { state, parameters, setpoint, previous } = *inputs;
    // The axes' origin is the tip's orientation, so their reference is the error itself.
    let measured = TaskSpaceInput {
        position: [0.0; 3],
        velocity: tip.angular_velocity(&state.joint_velocity).into(),
        reference_position: orientation_error(&setpoint.orientation, &tip.rotation, &previous.rotation.force),
        reference_velocity: setpoint.angular_velocity,
        contact_force: state.foot_moment,
    };
    let out = task_space::step(previous.rotation, &measured, &parameters.of_rotation(), PERIOD_S).ok()?;
    Some(RotationRequest { error: out.error, error_rate: out.error_rate, moment: out.force, state: out.state })
}
