//! Access to the fields of every message, for their corruption.

use super::draw::Sampler;
use hapfic_messages::{
    Command, ControllerState, Credit, Event, Operator, OperatorReply, OperatorRequest, Parameters, PlannerState, Reference,
    Request, State, Timing,
};
use std::slice::from_mut;

/// Largest number of corrupted fields in one message.
const MAX_CORRUPTED_FIELDS: usize = 5;

/// Adjacent fields of one kind.
pub(super) enum FieldGroup<'a> {
    Numbers(&'a mut [f64]),
    /// Codes, small counts, flags.
    Codes(&'a mut [u32]),
    /// Times, versions, numbers of ticks.
    Counts(&'a mut [u64]),
    Ticks(&'a mut [i64]),
    Bytes(&'a mut [u8]),
}

use FieldGroup::{Bytes, Codes, Counts, Numbers, Ticks};

/// Message with accessible fields.
pub(super) trait FieldAccess {
    fn fields(&mut self) -> Vec<FieldGroup<'_>>;
}

/// Corrupts zero to five fields of a message.
pub(super) fn corrupt<T: FieldAccess>(message: &mut T, sampler: &mut Sampler<'_>) {
    for _ in 0..sampler.below(MAX_CORRUPTED_FIELDS + 1) {
        let mut fields = message.fields();
        let index = sampler.below(fields.len());
        match &mut fields[index] {
            Numbers(values) => {
                if sampler.byte().is_multiple_of(8) {
                    let new = sampler.number(values[0]);
                    values.fill(new);
                } else {
                    let index = sampler.below(values.len());
                    values[index] = sampler.number(values[index]);
                }
            }
            Codes(values) => {
                let index = sampler.below(values.len());
                values[index] = sampler.code(values[index]);
            }
            Counts(values) => {
                let index = sampler.below(values.len());
                values[index] = sampler.count(values[index]);
            }
            Ticks(values) => {
                let index = sampler.below(values.len());
                values[index] = sampler.tick(values[index]);
            }
            Bytes(values) => {
                for byte in values.iter_mut().take(64) {
                    *byte = sampler.byte();
                }
            }
        }
    }
}

impl FieldAccess for State {
    fn fields(&mut self) -> Vec<FieldGroup<'_>> {
        let mut fields = vec![
            Counts(from_mut(&mut self.stamp_ns)),
            Ticks(from_mut(&mut self.tick)),
            Counts(from_mut(&mut self.time_ns)),
            Ticks(from_mut(&mut self.command_tick)),
            Counts(from_mut(&mut self.wake_lateness_ns)),
            Counts(from_mut(&mut self.slipped)),
            Codes(from_mut(&mut self.joints)),
            Codes(from_mut(&mut self.drive)),
            Codes(from_mut(&mut self.object_count)),
            Codes(from_mut(&mut self.contact_count)),
            Codes(from_mut(&mut self.limbs)),
            Codes(from_mut(&mut self.reserved)),
            Numbers(&mut self.joint_position),
            Numbers(&mut self.joint_velocity),
            Numbers(&mut self.joint_torque),
            Numbers(&mut self.foot_position),
            Numbers(&mut self.foot_velocity),
            Numbers(&mut self.foot_force),
            Numbers(&mut self.foot_orientation),
            Numbers(&mut self.foot_angular_velocity),
            Numbers(&mut self.foot_moment),
            Codes(from_mut(&mut self.physics.substeps)),
            Codes(from_mut(&mut self.physics.newton_iterations)),
            Codes(from_mut(&mut self.physics.unconverged)),
            Codes(from_mut(&mut self.physics.contact_substeps)),
            Numbers(from_mut(&mut self.physics.energy_j)),
            Numbers(from_mut(&mut self.physics.contact_work_j)),
            Numbers(from_mut(&mut self.physics.contact_stored_j)),
            Numbers(from_mut(&mut self.physics.joint_work_j)),
            Numbers(from_mut(&mut self.physics.joint_loss_j)),
            Numbers(from_mut(&mut self.physics.energy_error_j)),
            Codes(from_mut(&mut self.physics.cut_substeps)),
            Codes(from_mut(&mut self.physics.passages)),
            Codes(from_mut(&mut self.physics.passed_body)),
            Codes(from_mut(&mut self.physics.passed_against)),
        ];
        for object in &mut self.objects {
            fields.extend([
                Numbers(&mut object.position),
                Numbers(&mut object.orientation),
                Numbers(&mut object.linear_velocity),
                Numbers(&mut object.angular_velocity),
            ]);
        }
        // Two contacts represent all.
        for contact in self.contacts.iter_mut().take(2) {
            fields.extend([
                Codes(from_mut(&mut contact.body)),
                Codes(from_mut(&mut contact.against)),
                Numbers(&mut contact.point),
                Numbers(&mut contact.force),
                Numbers(from_mut(&mut contact.depth)),
            ]);
        }
        fields
    }
}

impl FieldAccess for PlannerState {
    fn fields(&mut self) -> Vec<FieldGroup<'_>> {
        let mut fields = vec![Counts(from_mut(&mut self.ticks))];
        fields.push(Counts(from_mut(&mut self.rotation.ticks)));
        fields.push(Counts(from_mut(&mut self.rotation.exists)));
        fields.push(Numbers(&mut self.rotation.target_rpy));
        for axis in self.axes.iter_mut().chain(&mut self.rotation.axes) {
            fields.extend([
                Numbers(from_mut(&mut axis.target)),
                Numbers(from_mut(&mut axis.start)),
                Numbers(from_mut(&mut axis.start_velocity)),
                Numbers(from_mut(&mut axis.brake_acceleration)),
                Numbers(from_mut(&mut axis.brake_time)),
                Numbers(from_mut(&mut axis.amplitude)),
                Numbers(from_mut(&mut axis.rate)),
                Numbers(from_mut(&mut axis.phase)),
            ]);
        }
        fields
    }
}

impl FieldAccess for Reference {
    fn fields(&mut self) -> Vec<FieldGroup<'_>> {
        let mut fields = vec![
            Counts(from_mut(&mut self.stamp_ns)),
            Ticks(from_mut(&mut self.tick)),
            Counts(from_mut(&mut self.parameters_version)),
            Codes(from_mut(&mut self.limbs)),
            Codes(from_mut(&mut self.reserved)),
            Numbers(&mut self.position),
            Numbers(&mut self.velocity),
            Numbers(&mut self.orientation),
            Numbers(&mut self.angular_velocity),
        ];
        fields.extend(self.planner.fields());
        fields
    }
}

impl FieldAccess for ControllerState {
    fn fields(&mut self) -> Vec<FieldGroup<'_>> {
        vec![
            Numbers(&mut self.offset),
            Numbers(&mut self.x_max),
            Numbers(&mut self.stiffness),
            Numbers(&mut self.max_force),
            Numbers(&mut self.position_bound),
            Numbers(&mut self.force),
            Numbers(&mut self.taper),
            Numbers(&mut self.force_error),
            Numbers(&mut self.slow_error),
            Numbers(&mut self.free_time),
            Numbers(&mut self.x_max_force),
            Codes(&mut self.converging),
            Codes(&mut self.at_rest_ticks),
        ]
    }
}

impl FieldAccess for Request {
    fn fields(&mut self) -> Vec<FieldGroup<'_>> {
        let mut fields = vec![
            Counts(from_mut(&mut self.stamp_ns)),
            Ticks(from_mut(&mut self.tick)),
            Ticks(from_mut(&mut self.state_tick)),
            Counts(from_mut(&mut self.parameters_version)),
            Codes(from_mut(&mut self.controller)),
            Codes(from_mut(&mut self.joints)),
            Codes(from_mut(&mut self.limbs)),
            Codes(from_mut(&mut self.reserved)),
            Numbers(&mut self.error),
            Numbers(&mut self.error_rate),
            Numbers(&mut self.force),
            Numbers(&mut self.torque),
            Numbers(&mut self.joint_space_torque),
            Numbers(&mut self.rotation.error),
            Numbers(&mut self.rotation.error_rate),
            Numbers(&mut self.rotation.moment),
        ];
        fields.extend(self.state.fields());
        fields.extend(self.rotation.state.fields());
        fields
    }
}

impl FieldAccess for Command {
    fn fields(&mut self) -> Vec<FieldGroup<'_>> {
        let mut fields = vec![
            Counts(from_mut(&mut self.stamp_ns)),
            Ticks(from_mut(&mut self.tick)),
            Codes(from_mut(&mut self.mode)),
            Codes(from_mut(&mut self.source)),
            Codes(from_mut(&mut self.severity)),
            Codes(from_mut(&mut self.joints)),
            Codes(from_mut(&mut self.limited)),
            Codes(from_mut(&mut self.ramped)),
            Codes(from_mut(&mut self.rate_limited)),
            Codes(from_mut(&mut self.limbs)),
            Numbers(&mut self.torque),
            Numbers(&mut self.gate.filtered),
            Counts(from_mut(&mut self.gate.stops)),
            Counts(from_mut(&mut self.gate.rearms)),
            Counts(from_mut(&mut self.gate.announced)),
            Codes(from_mut(&mut self.gate.ramping)),
            Codes(from_mut(&mut self.gate.primary)),
            Codes(from_mut(&mut self.gate.misses)),
            Codes(from_mut(&mut self.gate.missed)),
            Codes(from_mut(&mut self.gate.good)),
            Codes(from_mut(&mut self.gate.opened)),
        ];
        fields.extend(self.request.fields());
        fields
    }
}

impl FieldAccess for Parameters {
    fn fields(&mut self) -> Vec<FieldGroup<'_>> {
        vec![
            Counts(from_mut(&mut self.version)),
            Ticks(from_mut(&mut self.effective_tick)),
            Numbers(&mut self.target_position),
            Numbers(&mut self.desired_force),
            Numbers(&mut self.stiffness),
            Numbers(&mut self.max_force),
            Numbers(&mut self.position_bound),
            Codes(from_mut(&mut self.reset_policy)),
            Codes(from_mut(&mut self.saturation)),
            Codes(from_mut(&mut self.search)),
            Codes(from_mut(&mut self.gravity_compensation)),
            Codes(from_mut(&mut self.offset_anti_windup)),
            Codes(from_mut(&mut self.stall_release)),
            Codes(from_mut(&mut self.force_hold)),
            Codes(from_mut(&mut self.continuous_reentry)),
            Numbers(from_mut(&mut self.damping)),
            Numbers(from_mut(&mut self.posture_lead)),
            Numbers(from_mut(&mut self.taper)),
            Numbers(from_mut(&mut self.search_scale)),
            Numbers(from_mut(&mut self.force_resolution)),
            Numbers(from_mut(&mut self.mean_speed)),
            Numbers(from_mut(&mut self.max_acceleration)),
            Codes(from_mut(&mut self.task)),
            Codes(from_mut(&mut self.joints)),
            Numbers(&mut self.rotation.target_rpy),
            Numbers(&mut self.rotation.desired_moment),
            Numbers(&mut self.rotation.stiffness),
            Numbers(&mut self.rotation.max_moment),
            Numbers(&mut self.rotation.bound),
            Numbers(from_mut(&mut self.rotation.damping)),
            Numbers(from_mut(&mut self.rotation.moment_resolution)),
            Numbers(from_mut(&mut self.rotation.mean_speed)),
            Numbers(from_mut(&mut self.rotation.max_acceleration)),
            Numbers(&mut self.joint_space.posture),
            Numbers(from_mut(&mut self.joint_space.stiffness)),
            Numbers(from_mut(&mut self.joint_space.damping)),
            Numbers(from_mut(&mut self.joint_space.joint_damping)),
            Numbers(from_mut(&mut self.joint_space.limit_margin)),
            Numbers(from_mut(&mut self.joint_space.limit_stiffness)),
        ]
    }
}

impl FieldAccess for Operator {
    fn fields(&mut self) -> Vec<FieldGroup<'_>> {
        let mut fields = self.current.fields();
        fields.extend(self.next.fields());
        fields
    }
}

impl FieldAccess for Event {
    fn fields(&mut self) -> Vec<FieldGroup<'_>> {
        vec![
            Counts(from_mut(&mut self.stamp_ns)),
            Ticks(from_mut(&mut self.tick)),
            Codes(from_mut(&mut self.process)),
            Codes(from_mut(&mut self.kind)),
            Codes(from_mut(&mut self.severity)),
            Codes(from_mut(&mut self.detector)),
            Codes(from_mut(&mut self.text_len)),
            Codes(from_mut(&mut self.reserved)),
            Bytes(&mut self.text),
        ]
    }
}

impl FieldAccess for Timing {
    fn fields(&mut self) -> Vec<FieldGroup<'_>> {
        vec![
            Codes(from_mut(&mut self.process)),
            Codes(from_mut(&mut self.phase)),
            Ticks(from_mut(&mut self.tick)),
            Counts(from_mut(&mut self.due_ns)),
            Counts(from_mut(&mut self.wake_ns)),
            Counts(from_mut(&mut self.publish_ns)),
            Counts(from_mut(&mut self.latency_ns)),
            Codes(from_mut(&mut self.allocations)),
            Codes(from_mut(&mut self.rejected)),
            Codes(from_mut(&mut self.page_faults)),
            Codes(from_mut(&mut self.realtime)),
            Codes(from_mut(&mut self.generation)),
        ]
    }
}

impl FieldAccess for Credit {
    fn fields(&mut self) -> Vec<FieldGroup<'_>> {
        vec![Ticks(from_mut(&mut self.tick))]
    }
}

impl FieldAccess for OperatorRequest {
    fn fields(&mut self) -> Vec<FieldGroup<'_>> {
        vec![Codes(from_mut(&mut self.kind)), Codes(from_mut(&mut self.text_len)), Bytes(&mut self.text)]
    }
}

impl FieldAccess for OperatorReply {
    fn fields(&mut self) -> Vec<FieldGroup<'_>> {
        vec![
            Counts(from_mut(&mut self.version)),
            Ticks(from_mut(&mut self.tick)),
            Ticks(from_mut(&mut self.arrived_tick)),
            Ticks(from_mut(&mut self.taken_tick)),
            Codes(from_mut(&mut self.code)),
            Codes(from_mut(&mut self.text_len)),
            Bytes(&mut self.text),
        ]
    }
}
