//! Messages that a process's predecessor sent last, from which the process continues.

use crate::bus::Bus;
use crate::error::IpcError;
use crate::topic::Topic;
use core::sync::atomic::{AtomicI64, Ordering};
use hapfic_messages::{Check, Clock, Message, Process, TickBuffer, Ticked};

/// Ticks that a message may be ahead of the last command: the planner is one tick ahead, its state another.
const MAX_TICKS_AHEAD: i64 = 3;

/// The last messages of a sender, the oldest first, up to the newest before which no needed tick is missing.
///
/// `gated` is the tick of the last command.
pub(crate) fn last_messages<T: Check + Ticked + Message>(
    bus: &Bus,
    topic: &Topic<T>,
    sender: Process,
    clock: Clock,
    gated: &AtomicI64,
) -> Result<Vec<T>, IpcError> {
    let mut recent = TickBuffer::default();
    let done = gated.load(Ordering::Acquire);
    // A corrupt message must not become a successor's start, nor one of a tick that cannot be.
    let usable = |m: &T| m.check().is_ok() && (0..=done + MAX_TICKS_AHEAD).contains(&m.tick());
    bus.kept(topic, sender, clock)?.into_iter().filter(usable).for_each(|message| recent.insert(message));
    let mut last: Vec<T> = recent.iter().copied().collect();
    last.sort_by_key(Ticked::tick);
    let count = before_gap(last.iter().map(Ticked::tick), done);
    last.truncate(count);
    Ok(last)
}

/// How many of the ascending `ticks` come before the first gap behind the last tick `done`.
fn before_gap(ticks: impl Iterator<Item = i64>, done: i64) -> usize {
    let mut newest = None;
    ticks
        .take_while(|tick| {
            let follows = newest.is_none_or(|before| *tick <= done || *tick == before + 1);
            newest = Some(*tick);
            follows
        })
        .count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn before_gap_missing_needed_tick_stops_before_it() {
        let from = |ticks: &[i64], done| before_gap(ticks.iter().copied(), done);
        assert_eq!(from(&[], 5), 0);
        assert_eq!(from(&[0, 1], -1), 2);
        assert_eq!(from(&[3, 4, 5, 6, 7], 5), 5);
        assert_eq!(from(&[3, 4, 5, 7], 5), 3, "6 was never sent");
        assert_eq!(from(&[2, 4, 5, 6], 5), 4, "3 is not needed any more");
        assert_eq!(from(&[2, 3, 7], 5), 2);
    }
}
