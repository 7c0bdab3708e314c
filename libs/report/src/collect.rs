//! Data that a report collects from a log.

use crate::events::Events;
use crate::frames::SnapshotCandidates;
use crate::incidents::Incidents;
use crate::parameters::{ParameterSet, ParameterSets};
use crate::scene::{self, SceneContent};
use crate::series::Series;
use crate::tasks::Tasks;
use crate::timelines::Timelines;
use crate::timing::Histogram;
use crate::{LATEST_TICK, is_plausible, vector};
use foxglove::messages::{FrameTransforms, SceneUpdate};
use hapfic_log::metrics::angle_between;
use hapfic_log::{LogMessage, Metrics, Record, Topic, proto};
use nalgebra::{Point3, Vector3};
use prost::Message as _;

/// Most joints and objects in figures.
const MAX_PLOTTED_JOINTS: usize = 16;
const MAX_PLOTTED_OBJECTS: usize = 8;
/// Process whose timing has the latency from state to command.
const GATE: [&str; 2] = ["gate", "supervisor"];

/// Quantities of one axis of the world.
#[derive(Clone, Debug, Default)]
pub(crate) struct AxisSeries {
    /// x [m].
    pub(crate) position: Series,
    /// x_d [m].
    pub(crate) reference: Series,
    /// x_d - x_b and x_d + x_b [m].
    pub(crate) low: Series,
    pub(crate) high: Series,
    /// F [N].
    pub(crate) force: Series,
    /// F_d [N].
    pub(crate) desired: Series,
    /// F_c [N].
    pub(crate) command: Series,
    /// F_max [N].
    pub(crate) limit: Series,
    /// e_R [degrees], without the searched offset; empty in a position task, as all of the orientation.
    pub(crate) turned: Series,
    /// x_b,R [degrees].
    pub(crate) rotation_bound: Series,
    /// Moment of the controller [N m].
    pub(crate) moment: Series,
    /// T_max [N m].
    pub(crate) max_moment: Series,
    /// Measured moment [N m].
    pub(crate) measured_moment: Series,
}

/// Torques of one joint [N m; N for a prismatic joint].
#[derive(Clone, Debug, Default)]
pub(crate) struct JointSeries {
    pub(crate) raw: Series,
    pub(crate) conditioned: Series,
}

/// Free object.
#[derive(Clone, Debug)]
pub(crate) struct ObjectSeries {
    pub(crate) name: String,
    start: [f64; 4],
    /// Height of the centre of mass [m].
    pub(crate) height: Series,
    /// Angle of rotation from the start orientation [degrees].
    pub(crate) tilt: Series,
}

/// Data that a report collects from a log, of bounded size.
#[derive(Clone, Debug, Default)]
pub(crate) struct Collected {
    pub(crate) metrics: Metrics,
    pub(crate) axes: [AxisSeries; 3],
    pub(crate) joints: Vec<JointSeries>,
    pub(crate) objects: Vec<ObjectSeries>,
    pub(crate) contacts: Timelines,
    pub(crate) modes: Timelines,
    pub(crate) events: Events,
    pub(crate) incidents: Incidents,
    pub(crate) tasks: Tasks,
    pub(crate) latency: Histogram,
    pub(crate) lateness: Histogram,
    pub(crate) frames: SnapshotCandidates,
    /// Number of valid states.
    pub(crate) states: u64,
    /// Number of messages of any kind.
    pub(crate) messages: u64,
    pub(crate) last_tick: i64,
    sets: ParameterSets,
    /// Pairs with their first contact since the last viewer frame; at most as many as rows.
    touched: Vec<(String, String)>,
    /// Last position of the foot [m] and the force on it [N].
    foot: Option<(Point3<f64>, f64)>,
}

impl Collected {
    /// Adds a message of the log.
    pub(crate) fn push(&mut self, entry: &LogMessage) {
        self.messages += 1;
        self.metrics.push(&entry.record);
        match &entry.record {
            Record::State(state) => self.state(state),
            Record::Reference(reference) => self.reference(reference),
            Record::Command(command) => self.command(command),
            Record::Operator(operator) => self.operator(operator),
            Record::Event(event) => {
                self.events.push(event);
                self.tasks.push(event);
            }
            Record::Timing(timing) => self.timing(timing),
            Record::Request(_) => {}
            Record::Other { schema, data } => self.viewer(schema, data, i64::from(entry.sequence)),
        }
    }

    fn state(&mut self, state: &proto::State) {
        let tick = state.tick;
        if !(0..=LATEST_TICK).contains(&tick) {
            return;
        }
        self.states += 1;
        self.last_tick = self.last_tick.max(tick);
        let desired = self.sets.in_force(tick).map(|set| set.desired_force);
        if let (Some(position), Some(force)) = (vector(&state.foot_position), vector(&state.foot_force)) {
            for (i, axis) in self.axes.iter_mut().enumerate() {
                axis.position.push(tick, position[i]);
                axis.force.push(tick, force[i]);
                if let Some(desired) = desired {
                    axis.desired.push(tick, desired[i]);
                }
            }
            self.foot = Some((position.into(), Vector3::from(force).norm()));
        }
        if let Some(moment) = vector(&state.foot_moment) {
            for (axis, moment) in self.axes.iter_mut().zip(moment) {
                axis.measured_moment.push(tick, moment);
            }
        }
        for (i, object) in state.objects.iter().take(MAX_PLOTTED_OBJECTS).enumerate() {
            self.object(i, tick, object);
        }
        for contact in &state.contacts {
            if self.contacts.push(&contact.body, &contact.against, tick) {
                self.touched.push((contact.body.clone(), contact.against.clone()));
            }
        }
        self.modes.push("drive", &state.drive, tick);
        self.lateness.push(state.wake_lateness_ns);
    }

    fn object(&mut self, index: usize, tick: i64, object: &proto::Object) {
        let Some(position) = vector(&object.position) else { return };
        let Ok(orientation) = <[f64; 4]>::try_from(object.orientation.as_slice()) else { return };
        if !orientation.into_iter().all(is_plausible) {
            return;
        }
        if index == self.objects.len() {
            let (height, tilt) = (Series::default(), Series::default());
            self.objects.push(ObjectSeries { name: object.name.clone(), start: orientation, height, tilt });
        }
        if let Some(series) = self.objects.get_mut(index) {
            series.height.push(tick, position[2]);
            series.tilt.push(tick, angle_between(series.start, orientation).to_degrees());
        }
    }

    fn reference(&mut self, reference: &proto::Reference) {
        let tick = reference.tick;
        let bound = self.sets.in_force(tick).map(|set| set.bound);
        let Some(position) = vector(&reference.position) else { return };
        for (i, axis) in self.axes.iter_mut().enumerate() {
            axis.reference.push(tick, position[i]);
            if let Some(bound) = bound {
                axis.low.push(tick, position[i] - bound[i]);
                axis.high.push(tick, position[i] + bound[i]);
            }
        }
    }

    fn command(&mut self, command: &proto::Command) {
        let tick = command.tick;
        let (limit, max_moment, rotation_bound) = match self.sets.in_force(tick) {
            Some(set) => (Some(set.max_force), set.max_moment, set.rotation_bound),
            None => (None, None, None),
        };
        let force = match command.mode.as_str() {
            "active" => vector(&command.force),
            // The command repeats an older request, and its force does not act.
            "brake" | "stopped" => Some([0.0; 3]),
            _ => None,
        };
        if let Some(force) = force {
            for (axis, force) in self.axes.iter_mut().zip(force) {
                axis.command.push(tick, force);
            }
        }
        if let (Some(error), Some(offset), Some(moment)) =
            (vector(&command.rotation_error), vector(&command.rotation_offset), vector(&command.moment))
            && command.mode == "active"
        {
            for (i, axis) in self.axes.iter_mut().enumerate() {
                axis.turned.push(tick, (error[i] - offset[i]).to_degrees());
                axis.moment.push(tick, moment[i]);
                if let (Some(max_moment), Some(bound)) = (max_moment, rotation_bound) {
                    axis.max_moment.push(tick, max_moment[i]);
                    axis.rotation_bound.push(tick, bound[i].to_degrees());
                }
            }
        }
        if let Some(limit) = limit {
            for (axis, limit) in self.axes.iter_mut().zip(limit) {
                axis.limit.push(tick, limit);
            }
        }
        let joints = command.torque.len().min(MAX_PLOTTED_JOINTS);
        if self.joints.len() < joints {
            self.joints.resize_with(joints, JointSeries::default);
        }
        for (joint, (raw, conditioned)) in self.joints.iter_mut().zip(command.torque_raw.iter().zip(&command.torque)) {
            joint.raw.push(tick, *raw);
            joint.conditioned.push(tick, *conditioned);
        }
        self.modes.push("command", &command.mode, tick);
        self.modes.push("severity", &command.severity, tick);
        // Sender of the torque; a brake has none.
        if command.mode == "active" {
            self.modes.push("torque from", &command.controller, tick);
        }
        self.incidents.push(tick, &command.severity);
    }

    fn operator(&mut self, operator: &proto::Operator) {
        if let Some(set) = ParameterSet::new(operator) {
            let changes = self.sets.add_set(set);
            self.events.changed(operator.effective_tick, operator.version, &changes);
        }
    }

    fn timing(&mut self, timing: &proto::Timing) {
        if GATE.contains(&timing.process.as_str()) && timing.publish_ns != 0 && timing.latency_ns != 0 {
            self.latency.push(timing.latency_ns);
        }
    }

    /// Adds a message for viewers. An invalid message is skipped.
    fn viewer(&mut self, schema: &str, data: &[u8], tick: i64) {
        if schema == Topic::Transforms.schema_name() {
            if let Ok(message) = FrameTransforms::decode(data) {
                self.frames.set_poses(scene::poses(&message));
            }
        } else if schema == Topic::Scene.schema_name()
            && let Ok(message) = SceneUpdate::decode(data)
        {
            let objects = self.objects.iter().map(|object| object.name.as_str());
            let touched = std::mem::take(&mut self.touched);
            self.frames.add(tick, SceneContent::new(&message), objects, self.foot, touched);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn command_braking_counts_as_zero_force() {
        let mut collected = Collected::default();
        for tick in 0..40 {
            let mode = ["hold", "active", "brake", "stopped"][tick as usize / 10].to_owned();
            collected.command(&proto::Command { tick, mode, force: vec![5.0; 3], ..proto::Command::default() });
        }
        assert_eq!(collected.axes[2].command.points(1.0), [(0.01, 5.0), (0.019, 5.0), (0.02, 0.0), (0.039, 0.0)]);
    }
}
