//! Conversion of the messages between processes to messages of the log.
//!
//! Joint lists are cut to the joints of the robot, codes become names. A code without a name becomes `unknown`: the log
//! records invalid messages, too.

use crate::names::Names;
use crate::proto;
use hapfic_messages::{
    AxisPlan, Command, ContactState, Detector, Drive, Event, EventKind, Mode, ObjectState, Parameters, Phase, Physics, Process,
    Reference, Request, ResetPolicy, Saturation, Search, Severity, Source, State, Task, Timing,
};

const UNKNOWN: &str = "unknown";

/// Topic `/state`.
#[must_use]
pub fn state(state: &State, names: &Names) -> proto::State {
    let objects = state.objects.iter().take(state.object_count as usize).enumerate();
    let contacts = state.contacts.iter().take(state.contact_count as usize);
    proto::State {
        tick: state.tick,
        time_ns: state.time_ns,
        joint_position: first(&state.joint_position, state.joints),
        joint_velocity: first(&state.joint_velocity, state.joints),
        joint_torque: first(&state.joint_torque, state.joints),
        foot_position: state.foot_position.to_vec(),
        foot_velocity: state.foot_velocity.to_vec(),
        foot_force: state.foot_force.to_vec(),
        command_tick: state.command_tick,
        wake_lateness_ns: state.wake_lateness_ns,
        objects: objects.map(|(index, body)| object(body, names.object(index))).collect(),
        slipped: state.slipped,
        drive: Drive::from_code(state.drive).map_or(UNKNOWN, Drive::name).to_owned(),
        contacts: contacts.map(|c| contact(c, names)).collect(),
        physics: Some(physics(&state.physics, names)),
        foot_orientation: state.foot_orientation.to_vec(),
        foot_angular_velocity: state.foot_angular_velocity.to_vec(),
        foot_moment: state.foot_moment.to_vec(),
    }
}

/// Topic `/reference`.
#[must_use]
pub fn reference(reference: &Reference) -> proto::Reference {
    // A quaternion is never zero.
    let pose = reference.orientation != [0.0; 4];
    let plan = &reference.planner.rotation;
    proto::Reference {
        tick: reference.tick,
        position: reference.position.to_vec(),
        velocity: reference.velocity.to_vec(),
        parameters_version: reference.parameters_version,
        planner: Some(proto::PlannerState {
            ticks: reference.planner.ticks,
            axes: reference.planner.axes.iter().map(axis_plan).collect(),
            rotation_ticks: plan.ticks,
            target_rpy: only(pose, &plan.target_rpy),
            rotation_axes: plan.axes.iter().filter(|_| pose).map(axis_plan).collect(),
        }),
        orientation: only(pose, &reference.orientation),
        angular_velocity: only(pose, &reference.angular_velocity),
    }
}

/// Topics `/request` and `/request/standby`.
#[must_use]
pub fn request(request: &Request) -> proto::Request {
    let pose = turns(request);
    proto::Request {
        tick: request.tick,
        state_tick: request.state_tick,
        controller: controller(request.controller).to_owned(),
        parameters_version: request.parameters_version,
        error: request.error.to_vec(),
        error_rate: request.error_rate.to_vec(),
        offset: request.state.offset.to_vec(),
        x_max: request.state.x_max.to_vec(),
        converging: flags(&request.state.converging),
        force: request.force.to_vec(),
        torque: first(&request.torque, request.joints),
        at_rest_ticks: request.state.at_rest_ticks.to_vec(),
        taper: request.state.taper.to_vec(),
        rotation_error: only(pose, &request.rotation.error),
        rotation_error_rate: only(pose, &request.rotation.error_rate),
        moment: only(pose, &request.rotation.moment),
        rotation_offset: only(pose, &request.rotation.state.offset),
        joint_space_torque: first(&request.joint_space_torque, request.joints),
    }
}

/// Topic `/command`.
#[must_use]
pub fn command(command: &Command) -> proto::Command {
    let request = &command.request;
    let pose = turns(request);
    proto::Command {
        tick: command.tick,
        // The joint count of the command: before the first request, that of the request is zero.
        torque_raw: first(&request.torque, command.joints),
        torque: first(&command.torque, command.joints),
        controller: controller(request.controller).to_owned(),
        mode: Mode::from_code(command.mode).map_or(UNKNOWN, Mode::name).to_owned(),
        state_tick: request.state_tick,
        parameters_version: request.parameters_version,
        error: request.error.to_vec(),
        error_rate: request.error_rate.to_vec(),
        offset: request.state.offset.to_vec(),
        x_max: request.state.x_max.to_vec(),
        converging: flags(&request.state.converging),
        force: request.force.to_vec(),
        source: Source::from_code(command.source).map_or(UNKNOWN, Source::name).to_owned(),
        severity: severity(command.severity).to_owned(),
        limited: command.limited,
        ramped: command.ramped,
        rate_limited: command.rate_limited,
        at_rest_ticks: request.state.at_rest_ticks.to_vec(),
        taper: request.state.taper.to_vec(),
        rotation_error: only(pose, &request.rotation.error),
        rotation_error_rate: only(pose, &request.rotation.error_rate),
        moment: only(pose, &request.rotation.moment),
        rotation_offset: only(pose, &request.rotation.state.offset),
        joint_space_torque: first(&request.joint_space_torque, command.joints),
    }
}

/// Topic `/operator`.
#[must_use]
pub fn operator(parameters: &Parameters) -> proto::Operator {
    let (pose, rotation, joint_space) = (parameters.is_pose(), &parameters.rotation, &parameters.joint_space);
    proto::Operator {
        version: parameters.version,
        effective_tick: parameters.effective_tick,
        target_position: parameters.target_position.to_vec(),
        desired_force: parameters.desired_force.to_vec(),
        stiffness: parameters.stiffness.to_vec(),
        max_force: parameters.max_force.to_vec(),
        position_bound: parameters.position_bound.to_vec(),
        reset_policy: ResetPolicy::from_code(parameters.reset_policy).map_or(UNKNOWN, ResetPolicy::name).to_owned(),
        saturation: Saturation::from_code(parameters.saturation).map_or(UNKNOWN, Saturation::name).to_owned(),
        search: Search::from_code(parameters.search).map_or(UNKNOWN, Search::name).to_owned(),
        taper: parameters.taper,
        mean_speed: parameters.mean_speed,
        search_scale: parameters.search_scale,
        force_resolution: parameters.force_resolution,
        max_acceleration: parameters.max_acceleration,
        gravity_compensation: parameters.gravity_compensation != 0,
        offset_anti_windup: parameters.offset_anti_windup != 0,
        stall_release: parameters.stall_release != 0,
        force_hold: parameters.force_hold != 0,
        continuous_reentry: parameters.continuous_reentry != 0,
        damping: parameters.damping,
        posture_lead: parameters.posture_lead,
        task: Task::from_code(parameters.task).map_or(UNKNOWN, Task::name).to_owned(),
        target_orientation: only(pose, &rotation.target_rpy),
        desired_moment: only(pose, &rotation.desired_moment),
        rotation_stiffness: only(pose, &rotation.stiffness),
        max_moment: only(pose, &rotation.max_moment),
        rotation_bound: only(pose, &rotation.bound),
        rotation_damping: rotation.damping,
        moment_resolution: rotation.moment_resolution,
        mean_turn_speed: rotation.mean_speed,
        max_turn_acceleration: rotation.max_acceleration,
        posture: first(&joint_space.posture, if joint_space.acts() { parameters.joints } else { 0 }),
        posture_stiffness: joint_space.stiffness,
        posture_damping: joint_space.damping,
        joint_damping: joint_space.joint_damping,
        limit_margin: joint_space.limit_margin,
        limit_stiffness: joint_space.limit_stiffness,
    }
}

/// Topic `/event`. Bytes that are not UTF-8 are replaced.
#[must_use]
pub fn event(event: &Event) -> proto::Event {
    let text = event.text.get(..event.text_len as usize).unwrap_or(&event.text);
    proto::Event {
        tick: event.tick,
        process: process(event.process).to_owned(),
        kind: EventKind::from_code(event.kind).map_or(UNKNOWN, EventKind::name).to_owned(),
        severity: severity(event.severity).to_owned(),
        detector: Detector::from_code(event.detector).map_or(UNKNOWN, Detector::name).to_owned(),
        text: String::from_utf8_lossy(text).into_owned(),
    }
}

/// Topic `/timing`.
#[must_use]
pub fn timing(timing: &Timing) -> proto::Timing {
    proto::Timing {
        tick: timing.tick,
        process: process(timing.process).to_owned(),
        phase: Phase::from_code(timing.phase).map_or(UNKNOWN, Phase::name).to_owned(),
        due_ns: timing.due_ns,
        wake_ns: timing.wake_ns,
        publish_ns: timing.publish_ns,
        latency_ns: timing.latency_ns,
        wake_lateness_ns: timing.wake_ns.saturating_sub(timing.due_ns),
        allocations: timing.allocations,
        rejected: timing.rejected,
        page_faults: timing.page_faults,
        generation: timing.generation,
    }
}

fn object(body: &ObjectState, name: String) -> proto::Object {
    proto::Object {
        name,
        position: body.position.to_vec(),
        orientation: body.orientation.to_vec(),
        linear_velocity: body.linear_velocity.to_vec(),
        angular_velocity: body.angular_velocity.to_vec(),
    }
}

fn contact(contact: &ContactState, names: &Names) -> proto::Contact {
    proto::Contact {
        body: names.body(contact.body),
        against: names.body(contact.against),
        point: contact.point.to_vec(),
        force: contact.force.to_vec(),
        depth: contact.depth,
    }
}

fn physics(physics: &Physics, names: &Names) -> proto::Physics {
    let passed = |body| if physics.passages > 0 { names.body(body) } else { String::new() };
    proto::Physics {
        substeps: physics.substeps,
        newton_iterations: physics.newton_iterations,
        unconverged: physics.unconverged,
        energy_j: physics.energy_j,
        contact_work_j: physics.contact_work_j,
        contact_stored_j: physics.contact_stored_j,
        contact_substeps: physics.contact_substeps,
        joint_work_j: physics.joint_work_j,
        joint_loss_j: physics.joint_loss_j,
        energy_error_j: physics.energy_error_j,
        cut_substeps: physics.cut_substeps,
        passages: physics.passages,
        passed_body: passed(physics.passed_body),
        passed_against: passed(physics.passed_against),
    }
}

fn axis_plan(plan: &AxisPlan) -> proto::AxisPlan {
    proto::AxisPlan {
        target: plan.target,
        start: plan.start,
        start_velocity: plan.start_velocity,
        brake_acceleration: plan.brake_acceleration,
        brake_time: plan.brake_time,
        amplitude: plan.amplitude,
        rate: plan.rate,
        phase: plan.phase,
    }
}

/// Whether a request controls the orientation: its gains are then above zero.
fn turns(request: &Request) -> bool {
    request.rotation.state.stiffness != [0.0; 3]
}

/// The values, or nothing.
fn only(given: bool, values: &[f64]) -> Vec<f64> {
    if given { values.to_vec() } else { Vec::new() }
}

fn first(values: &[f64], count: u32) -> Vec<f64> {
    values.iter().take(count as usize).copied().collect()
}

fn flags(codes: &[u32]) -> Vec<bool> {
    codes.iter().map(|&code| code != 0).collect()
}

fn process(code: u32) -> &'static str {
    Process::from_code(code).map_or(UNKNOWN, Process::name)
}

fn severity(code: u32) -> &'static str {
    Severity::from_code(code).map_or(UNKNOWN, Severity::name)
}

/// Name of the controller that sent a request.
///
/// The zeroed request before the first request carries the supervisor's code.
fn controller(code: u32) -> &'static str {
    match Process::from_code(code) {
        Some(sender @ (Process::Controller | Process::Standby)) => sender.name(),
        Some(_) => "none",
        None => UNKNOWN,
    }
}
