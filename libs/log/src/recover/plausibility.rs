//! Plausibility check of messages without a checksum.

use super::records::MessageRecord;
use crate::topic::Topic;
use crate::{TICK_NS, proto, time_of};
use foxglove::messages::{FrameTransforms, Log, SceneUpdate};
use hapfic_messages::Process;
use prost::Message as _;
use std::collections::BTreeSet;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Known properties of the log, for comparison with messages.
#[derive(Default)]
pub(super) struct PlausibilityCheck {
    /// Time of tick 0 by a message of a chunk with a right checksum [ns].
    start: Option<u64>,
    /// Time of tick 0 by the first message of this chunk [ns].
    guess: Option<u64>,
    /// Last tick of `/state` and `/command`.
    last: [Option<i64>; 2],
    /// Hashes of the messages of this chunk.
    seen: BTreeSet<u64>,
}

/// Result of the check of a message.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Plausibility {
    /// The message is plausible and new.
    Valid,
    /// The message has been kept already.
    Repeated,
    /// The writer cannot have written the message.
    Invalid,
}

impl PlausibilityCheck {
    /// Begins a chunk.
    pub(super) fn begin(&mut self) {
        self.seen.clear();
        self.guess = None;
    }

    /// Takes the time of tick 0 from a message under a right checksum.
    pub(super) fn observe(&mut self, topic: Option<Topic>, message: &MessageRecord<'_>) {
        if self.start.is_none() {
            self.start = topic.and_then(|topic| start_of(topic, message));
        }
    }

    /// Checks a message of a chunk without a right checksum, or, with `checked`, a message of an uncertain topic.
    ///
    /// Never rejects a message as [`Writer`](crate::Writer) writes it during a run.
    pub(super) fn check(&mut self, topic: Topic, message: &MessageRecord<'_>, checked: bool) -> Plausibility {
        if self.guess.is_none() {
            self.guess = start_of(topic, message);
        }
        if message.publish_time != message.log_time || !self.is_plausible(topic, message, checked) {
            return Plausibility::Invalid;
        }
        let mut hasher = DefaultHasher::new();
        (topic, message.sequence, message.log_time, message.data).hash(&mut hasher);
        if self.seen.insert(hasher.finish()) { Plausibility::Valid } else { Plausibility::Repeated }
    }

    fn is_plausible(&mut self, topic: Topic, message: &MessageRecord<'_>, checked: bool) -> bool {
        let data = message.data;
        let tick = match topic {
            Topic::State => proto::State::decode(data).ok().filter(state_is_finite).map(|m| m.tick),
            Topic::Reference => {
                proto::Reference::decode(data).ok().filter(|m| are_finite(&[&m.position, &m.velocity])).map(|m| m.tick)
            }
            Topic::Request | Topic::StandbyRequest => proto::Request::decode(data)
                .ok()
                // An altered bit of a channel's number exchanges the two topics.
                .filter(|m| (m.controller == Process::Standby.name()) == (topic == Topic::StandbyRequest))
                .filter(|m| are_finite(&[&m.error, &m.error_rate, &m.force, &m.torque]))
                .map(|m| m.tick),
            Topic::Command => {
                proto::Command::decode(data).ok().filter(|m| are_finite(&[&m.torque, &m.torque_raw])).map(|m| m.tick)
            }
            Topic::Operator => proto::Operator::decode(data).ok().filter(operator_is_finite).map(|m| m.effective_tick),
            Topic::Event => proto::Event::decode(data).ok().map(|m| m.tick),
            Topic::Timing => {
                // The topic has its own time.
                return proto::Timing::decode(data).is_ok_and(|m| m.tick as u32 == message.sequence);
            }
            Topic::Transforms => FrameTransforms::decode(data).ok().and_then(|_| self.tick_by_time(message)),
            Topic::Scene => SceneUpdate::decode(data).ok().and_then(|_| self.tick_by_time(message)),
            Topic::Log => Log::decode(data).ok().and_then(|_| self.tick_by_time(message)),
        };
        let Some(tick) = tick.filter(|&tick| self.agrees(tick, message)) else { return false };
        let last = match topic {
            Topic::State => &mut self.last[0],
            Topic::Command => &mut self.last[1],
            _ => return true,
        };
        // A restarted plant continues from its last tick.
        if !checked && last.is_some_and(|last| tick < last) {
            return false;
        }
        *last = Some(tick);
        true
    }

    /// Whether number and time of a message agree with its tick.
    fn agrees(&self, tick: i64, message: &MessageRecord<'_>) -> bool {
        tick as u32 == message.sequence && self.start.or(self.guess).is_none_or(|start| time_of(start, tick) == message.log_time)
    }

    /// Returns the tick of a message without a tick field.
    fn tick_by_time(&self, message: &MessageRecord<'_>) -> Option<i64> {
        let start = self.start.or(self.guess)?;
        let by_time = message.log_time.wrapping_sub(start) as i64 / TICK_NS;
        // Before tick 0 the time may be clamped to zero.
        let by_number = i64::from(message.sequence as i32);
        [by_time, by_number].into_iter().find(|&tick| self.agrees(tick, message))
    }
}

/// Returns the time of tick 0 by a message, if the message determines it.
fn start_of(topic: Topic, message: &MessageRecord<'_>) -> Option<u64> {
    // Timing has its own time, and before tick 0 the time may be clamped to zero.
    let tick = u64::try_from(message.sequence as i32).ok().filter(|_| topic != Topic::Timing)?;
    message.log_time.checked_sub(tick * TICK_NS as u64)
}

fn state_is_finite(m: &proto::State) -> bool {
    let joints = [&m.joint_position, &m.joint_velocity, &m.joint_torque];
    let foot = [&m.foot_position, &m.foot_velocity, &m.foot_force, &m.foot_orientation, &m.foot_angular_velocity, &m.foot_moment];
    let object = |o: &proto::Object| are_finite(&[&o.position, &o.orientation, &o.linear_velocity, &o.angular_velocity]);
    let contact = |c: &proto::Contact| are_finite(&[&c.point, &c.force]) && c.depth.is_finite();
    let physics = m.physics.as_ref().is_none_or(|p| {
        let sums = [p.energy_j, p.contact_work_j, p.contact_stored_j, p.joint_work_j, p.joint_loss_j, p.energy_error_j];
        sums.into_iter().all(f64::is_finite)
    });
    are_finite(&joints) && are_finite(&foot) && m.objects.iter().all(object) && m.contacts.iter().all(contact) && physics
}

fn operator_is_finite(m: &proto::Operator) -> bool {
    let vectors = [
        &m.target_position,
        &m.desired_force,
        &m.stiffness,
        &m.max_force,
        &m.position_bound,
        &m.target_orientation,
        &m.desired_moment,
        &m.rotation_stiffness,
        &m.max_moment,
        &m.rotation_bound,
        &m.posture,
    ];
    let numbers = [m.taper, m.mean_speed, m.search_scale, m.force_resolution, m.max_acceleration];
    are_finite(&vectors) && numbers.into_iter().all(f64::is_finite)
}

fn are_finite(lists: &[&Vec<f64>]) -> bool {
    lists.iter().all(|list| list.iter().all(|value| value.is_finite()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK: i64 = 7;

    /// Whether a message of tick 7 without a checksum is valid.
    fn is_valid(topic: Topic, message: &impl prost::Message) -> bool {
        let data = message.encode_to_vec();
        let log_time = time_of(0, TICK);
        let message = MessageRecord { channel: 1, sequence: TICK as u32, log_time, publish_time: log_time, data: &data };
        PlausibilityCheck::default().check(topic, &message, false) == Plausibility::Valid
    }

    #[test]
    fn plausibility_state_needs_finite_numbers() {
        let intact = || proto::State {
            tick: TICK,
            foot_force: vec![0.0, 0.0, 50.0],
            objects: vec![proto::Object { position: vec![1.0; 3], orientation: vec![0.5; 4], ..proto::Object::default() }],
            contacts: vec![proto::Contact { point: vec![1.0; 3], force: vec![2.0; 3], ..proto::Contact::default() }],
            physics: Some(proto::Physics::default()),
            ..proto::State::default()
        };
        assert!(is_valid(Topic::State, &intact()));
        assert!(is_valid(Topic::State, &proto::State { tick: TICK, ..proto::State::default() }));
        let damages: [fn(&mut proto::State, f64); 12] = [
            |m, v| m.joint_torque.push(v),
            |m, v| m.foot_force[1] = v,
            |m, v| m.objects[0].position[2] = v,
            |m, v| m.objects[0].orientation[3] = v,
            |m, v| m.objects[0].linear_velocity.push(v),
            |m, v| m.objects[0].angular_velocity.push(v),
            |m, v| m.contacts[0].point[0] = v,
            |m, v| m.contacts[0].force[1] = v,
            |m, v| m.contacts[0].depth = v,
            |m, v| m.physics.get_or_insert_default().energy_j = v,
            |m, v| m.physics.get_or_insert_default().contact_stored_j = v,
            |m, v| m.physics.get_or_insert_default().energy_error_j = v,
        ];
        for (index, damage) in damages.into_iter().enumerate() {
            for value in [f64::NAN, f64::NEG_INFINITY] {
                let mut damaged = intact();
                damage(&mut damaged, value);
                assert!(!is_valid(Topic::State, &damaged), "damage {index}, {value}");
            }
        }
    }

    #[test]
    fn plausibility_request_needs_topic_of_its_controller() {
        for controller in ["controller", "standby", "none", "unknown"] {
            let request = proto::Request { tick: TICK, controller: controller.to_owned(), ..proto::Request::default() };
            assert_eq!(is_valid(Topic::Request, &request), controller != "standby", "{controller}");
            assert_eq!(is_valid(Topic::StandbyRequest, &request), controller == "standby", "{controller}");
        }
        let standby = proto::Request { tick: TICK, controller: "standby".to_owned(), ..proto::Request::default() };
        assert!(!is_valid(Topic::StandbyRequest, &proto::Request { torque: vec![f64::NAN], ..standby }));
    }

    #[test]
    fn plausibility_parameter_set_needs_finite_numbers() {
        let intact =
            || proto::Operator { effective_tick: TICK, desired_force: vec![0.0, 0.0, 50.0], ..proto::Operator::default() };
        assert!(is_valid(Topic::Operator, &intact()));
        let damages: [fn(&mut proto::Operator, f64); 4] =
            [|m, v| m.desired_force[2] = v, |m, v| m.position_bound.push(v), |m, v| m.taper = v, |m, v| m.max_acceleration = v];
        for (index, damage) in damages.into_iter().enumerate() {
            let mut damaged = intact();
            damage(&mut damaged, f64::INFINITY);
            assert!(!is_valid(Topic::Operator, &damaged), "damage {index}");
        }
    }
}
