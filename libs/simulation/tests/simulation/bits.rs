//! The numbers of a tick, bit for bit.

use hapfic_simulation::Snapshot;

/// Bits of all numbers of plant, planner, controller and gate in a tick.
pub fn bits(snapshot: &Snapshot) -> Vec<u64> {
    let Snapshot { state, reference, command, operator } = snapshot;
    let mut all = Vec::with_capacity(256);
    let mut add = |values: &[f64]| all.extend(values.iter().map(|value| value.to_bits()));
    for values in [&state.joint_position, &state.joint_velocity, &state.joint_torque, &command.torque, &command.request.torque] {
        add(values);
    }
    let (request, previous_state) = (&command.request, &command.request.state);
    for values in [
        &state.foot_position,
        &state.foot_velocity,
        &state.foot_force,
        &reference.position,
        &reference.velocity,
        &request.error,
        &request.error_rate,
        &request.force,
        &previous_state.offset,
        &previous_state.x_max,
        &previous_state.stiffness,
        &previous_state.max_force,
        &previous_state.position_bound,
        &previous_state.force,
        &previous_state.taper,
        &previous_state.force_error,
        &previous_state.slow_error,
        &previous_state.free_time,
        &previous_state.x_max_force,
    ] {
        add(values);
    }
    for axis in &reference.planner.axes {
        add(&[axis.target, axis.start, axis.start_velocity, axis.brake_acceleration, axis.brake_time]);
        add(&[axis.amplitude, axis.rate, axis.phase]);
    }
    for body in &state.objects[..state.object_count as usize] {
        add(&body.position);
        add(&body.orientation);
        add(&body.linear_velocity);
        add(&body.angular_velocity);
    }
    for contact in &state.contacts[..state.contact_count as usize] {
        add(&contact.point);
        add(&contact.force);
        add(&[contact.depth]);
    }
    add(&[state.physics.energy_j, state.physics.contact_work_j, state.physics.contact_stored_j]);
    all.extend(previous_state.converging.map(u64::from));
    all.extend(previous_state.at_rest_ticks.map(u64::from));
    all.extend([state.tick as u64, request.parameters_version, operator.next.version]);
    all
}
