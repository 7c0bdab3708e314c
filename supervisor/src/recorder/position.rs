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

/// Index in [`ticked`] of the messages that every tick has: states, references, commands.
const EVERY_TICK: [usize; 3] = [0, 1, 4];
/// Ticks that these are apart at most while all wait for a process, and while they are received at full speed.
const USUAL_LAG: i64 = 2;
const BUSY_LAG: i64 = 64;

/// Whether a tick is missing between the newest messages of each kind and received ones, in their order.
pub(super) fn has_gap(mut newest: [i64; 5], received: impl Iterator<Item = (usize, i64)>) -> bool {
    for (kind, tick) in received {
        if EVERY_TICK.contains(&kind) && tick > newest[kind] + 1 {
            return true;
        }
        newest[kind] = newest[kind].max(tick);
    }
    false
}

/// Whether one kind of message has come less far than the others, while none arrive (`idle`) or some do.
pub(super) fn has_lag(newest: &[i64; 5], idle: bool) -> bool {
    let farthest = EVERY_TICK.iter().map(|kind| newest[*kind]).max().unwrap_or(-1);
    farthest - least_of_every_tick(newest) > if idle { USUAL_LAG } else { BUSY_LAG }
}

/// The least tick of the kinds that every tick has.
pub(super) fn least_of_every_tick(newest: &[i64; 5]) -> i64 {
    EVERY_TICK.iter().map(|kind| newest[*kind]).min().unwrap_or(-1)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gap_and_lag_of_what_every_tick_has() {
        let newest = [10, 11, 3, -1, 9];
        let gap = |received: &[(usize, i64)]| has_gap(newest, received.iter().copied());
        assert!(!gap(&[(0, 11), (1, 12), (0, 12), (4, 10), (0, 9)]), "in order, or old");
        assert!(!gap(&[(2, 12), (3, 12)]), "a controller need not answer every tick");
        assert!(gap(&[(0, 11), (0, 13)]) && gap(&[(1, 13)]) && gap(&[(4, 11)]));
        assert!(!has_lag(&newest, true) && !has_lag(&[-1, -1, -1, -1, -2], true));
        assert!(has_lag(&[10, 7, 3, -1, 9], true) && has_lag(&[10, 11, 9, 9, 8], true));
        assert!(!has_lag(&[10, 7, 3, -1, 9], false) && has_lag(&[80, 11, 9, 9, 79], false));
    }
}
