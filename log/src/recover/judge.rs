//! Whether a message without a checksum may be believed.

use super::records::Message;
use crate::topic::Topic;
use crate::{TICK_NS, proto, time_of};
use foxglove::messages::{FrameTransforms, Log, SceneUpdate};
use prost::Message as _;
use std::collections::BTreeSet;
use std::hash::{DefaultHasher, Hash, Hasher};

/// What is known of the log, to compare messages with.
#[derive(Default)]
pub(super) struct Judge {
    /// Time of tick 0, ns, as a message of a chunk with a right checksum has it.
    start: Option<u64>,
    /// The same, as the first message of this chunk has it.
    guess: Option<u64>,
    /// Last tick of `/state` and `/command`.
    last: [Option<i64>; 2],
    /// Hashes of the messages of this chunk.
    seen: BTreeSet<u64>,
}

/// What is thought of a message.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It is to be kept.
    Good,
    /// It has been kept already.
    Repeated,
    /// It is not one that the writer could have written.
    Bad,
}

impl Judge {
    /// Begins a chunk.
    pub(super) fn begin(&mut self) {
        self.seen.clear();
        self.guess = None;
    }

    /// Takes note of a message that is known to be right.
    pub(super) fn learn(&mut self, topic: Option<Topic>, message: &Message<'_>) {
        if self.start.is_none() {
            self.start = topic.and_then(|topic| start_of(topic, message));
        }
    }

    /// Judges a message of a chunk whose checksum is wrong or missing; or, `checked`, one whose topic is not known for sure.
    ///
    /// Never refuses one as [`Writer`](crate::Writer) writes it in the course of a run.
    pub(super) fn judge(&mut self, topic: Topic, message: &Message<'_>, checked: bool) -> Verdict {
        if self.guess.is_none() {
            self.guess = start_of(topic, message);
        }
        if message.publish_time != message.log_time || !self.is_sound(topic, message, checked) {
            return Verdict::Bad;
        }
        let mut hasher = DefaultHasher::new();
        (topic, message.sequence, message.log_time, message.data).hash(&mut hasher);
        if self.seen.insert(hasher.finish()) { Verdict::Good } else { Verdict::Repeated }
    }

    fn is_sound(&mut self, topic: Topic, message: &Message<'_>, checked: bool) -> bool {
        let data = message.data;
        let tick = match topic {
            Topic::State => proto::State::decode(data).ok().filter(state_is_finite).map(|m| m.tick),
            Topic::Reference => {
                proto::Reference::decode(data).ok().filter(|m| are_finite(&[&m.position, &m.velocity])).map(|m| m.tick)
            }
            Topic::Request => proto::Request::decode(data)
                .ok()
                .filter(|m| are_finite(&[&m.error, &m.error_rate, &m.force, &m.torque]))
                .map(|m| m.tick),
            Topic::Command => {
                proto::Command::decode(data).ok().filter(|m| are_finite(&[&m.torque, &m.torque_raw])).map(|m| m.tick)
            }
            Topic::Operator => proto::Operator::decode(data).ok().map(|m| m.effective_tick),
            Topic::Event => proto::Event::decode(data).ok().map(|m| m.tick),
            Topic::Timing => {
                // Its time is its own.
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
        // A plant that is started again goes on from its last tick.
        if !checked && last.is_some_and(|last| tick < last) {
            return false;
        }
        *last = Some(tick);
        true
    }

    /// Whether number and time of a message are those of its tick.
    fn agrees(&self, tick: i64, message: &Message<'_>) -> bool {
        tick as u32 == message.sequence && self.start.or(self.guess).is_none_or(|start| time_of(start, tick) == message.log_time)
    }

    /// The tick of a message that does not say it itself.
    fn tick_by_time(&self, message: &Message<'_>) -> Option<i64> {
        let start = self.start.or(self.guess)?;
        let by_time = message.log_time.wrapping_sub(start) as i64 / TICK_NS;
        // Before tick 0 the time may have come to its end at zero.
        let by_number = i64::from(message.sequence as i32);
        [by_time, by_number].into_iter().find(|&tick| self.agrees(tick, message))
    }
}

/// Time of tick 0 by a message, if it says so.
fn start_of(topic: Topic, message: &Message<'_>) -> Option<u64> {
    // Timing has a time of its own, and before tick 0 the time may have come to its end at zero.
    let tick = u64::try_from(message.sequence as i32).ok().filter(|_| topic != Topic::Timing)?;
    message.log_time.checked_sub(tick * TICK_NS as u64)
}

fn state_is_finite(m: &proto::State) -> bool {
    let joints = [&m.joint_position, &m.joint_velocity, &m.joint_torque];
    let foot = [&m.foot_position, &m.foot_velocity, &m.foot_force];
    are_finite(&joints) && are_finite(&foot)
}

fn are_finite(lists: &[&Vec<f64>]) -> bool {
    lists.iter().all(|list| list.iter().all(|value| value.is_finite()))
}
