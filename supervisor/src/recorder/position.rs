//! How far a log has come: the newest message of each kind.

use super::RecordedMessage;
use hapfic_ipc::LogPosition;
use hapfic_ipc::run_status::RunStatus;
use hapfic_messages::{Event, Process, Request};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::atomic::Ordering;
use zerocopy::IntoBytes;

/// Ticks that a message may be ahead of the last command.
const MAX_TICKS_AHEAD: i64 = 3;

/// Index and tick of a message whose kind is numbered by ticks.
pub(super) fn ticked(record: &RecordedMessage) -> Option<(usize, i64)> {
    Some(match record {
        RecordedMessage::State(m) => (0, m.tick),
        RecordedMessage::Reference(m) => (1, m.tick),
        RecordedMessage::Request(m) => (2 + request_index(m), m.tick),
        RecordedMessage::Command(m) => (4, m.tick),
        _ => return None,
    })
}

/// Index of the controller that has sent a request.
pub(super) fn request_index(request: &Request) -> usize {
    usize::from(request.controller != Process::Controller.code())
}

/// Whether a tick can be that of a message of now: the others are recorded, and hide none.
pub(super) fn is_plausible(tick: i64, status: &RunStatus) -> bool {
    tick <= status.gate.tick.load(Ordering::Acquire) + MAX_TICKS_AHEAD
}

/// Identity of an event, the same in every process of this program.
pub(super) fn identity(event: &Event) -> u64 {
    let mut hasher = DefaultHasher::new();
    event.as_bytes().hash(&mut hasher);
    hasher.finish()
}

/// Counts a message in a position; events count by themselves.
pub(super) fn advance(position: &mut LogPosition, record: &RecordedMessage, status: &RunStatus) {
    if let Some((kind, tick)) = ticked(record) {
        if is_plausible(tick, status) {
            position.ticks[kind] = position.ticks[kind].max(tick);
        }
    } else if let RecordedMessage::Timing(m) = record
        && let Some(newest) = position.timing_ns.get_mut(m.process as usize)
    {
        *newest = m.wake_ns.max(*newest);
    }
}
