//! What outlives a process: the last states and references, to be handed to its successor.
//!
//! A publisher's history ends with it. So the supervisor listens, too, and after a death says once more what the dead one said
//! last: the successor goes on from there, and those who join later find it as if its publisher still lived.

use anyhow::Result;
use hapfic_ipc::inject::Corruptible;
use hapfic_ipc::topic::{self, Topic};
use hapfic_ipc::{Bus, Input, IpcError, Output, Wait};
use hapfic_messages::{Check, Message, Process, Reference, State, TickBuffer, Ticked};
use std::sync::atomic::{AtomicI64, Ordering};

/// How far ahead of the last command a message may be: the planner is one tick ahead, its state another.
const AHEAD: i64 = 3;

/// One topic that is kept.
struct CachedTopic<T: Message> {
    input: Input<T>,
    output: Output<T>,
    recent: TickBuffer<T>,
}

impl<T: Check + Corruptible + Ticked + Message> CachedTopic<T> {
    fn open(bus: &Bus, topic: &Topic<T>) -> Result<Self, IpcError> {
        Ok(Self { input: bus.input(topic, Wait::No)?, output: bus.output(topic)?, recent: TickBuffer::default() })
    }

    /// Takes in what has been said.
    fn listen(&mut self, gated: &AtomicI64) -> Result<(), IpcError> {
        while let Some(message) = self.input.next()? {
            // Its own words come back as well; and what is damaged is no start for anybody.
            if message.check().is_ok() && is_near(message.tick(), gated) {
                self.recent.insert(message);
            }
        }
        Ok(())
    }

    /// Says once more what was said last, oldest first. Returns the tick of the newest before which nothing is missing that is still
    /// needed; `None` if nothing was ever said.
    fn hand_over(&mut self, gated: &AtomicI64) -> Result<Option<i64>, IpcError> {
        self.listen(gated)?;
        let done = gated.load(Ordering::Acquire);
        let mut last: Vec<T> = self.recent.iter().copied().collect();
        last.sort_by_key(Ticked::tick);
        for message in &last {
            self.output.send(message)?;
            self.output.preloan();
        }
        Ok(without_gap(last.iter().map(Ticked::tick), done))
    }
}

/// Whether a message that has been received can be one of the last: a tick that lies further ahead is nobody's.
///
/// The last command's tick is looked up here, behind the message: looked up before, it may be some ticks old when the thread has not
/// been running in between, and what has been said meanwhile would be taken for nonsense, and lost.
fn is_near(tick: i64, gated: &AtomicI64) -> bool {
    (0..=gated.load(Ordering::Acquire) + AHEAD).contains(&tick)
}

/// The newest of some ticks, in ascending action, with no gap between it and the last tick that is done.
fn without_gap(ticks: impl Iterator<Item = i64>, done: i64) -> Option<i64> {
    let mut newest = None;
    for tick in ticks {
        match newest {
            Some(before) if tick > done && tick != before + 1 => break,
            _ => newest = Some(tick),
        }
    }
    newest
}

/// The last states and references.
pub struct HandOverCache {
    states: CachedTopic<State>,
    references: CachedTopic<Reference>,
}

impl HandOverCache {
    /// Begins to listen. To be called before anyone publishes.
    ///
    /// # Errors
    /// [`IpcError`] if the topics cannot be had.
    pub fn open(bus: &Bus) -> Result<Self, IpcError> {
        Ok(Self { states: CachedTopic::open(bus, &topic::STATE)?, references: CachedTopic::open(bus, &topic::REFERENCE)? })
    }

    /// After the death of a process: hands over what it said last. Returns the tick from which its successor goes on; `None` if
    /// it starts from nothing, as controllers always do.
    ///
    /// # Errors
    /// [`IpcError`] if messaging fails.
    pub fn hand_over(&mut self, process: Process, gated: &AtomicI64) -> Result<Option<i64>, IpcError> {
        match process {
            Process::Plant => self.states.hand_over(gated),
            Process::Planner => self.references.hand_over(gated),
            _ => Ok(None),
        }
    }

    /// Takes in what has been said. To be called often, and before the dead are swept away: with a dead process goes what nobody has
    /// taken in from it, unless it was met while it lived.
    ///
    /// # Errors
    /// [`IpcError`] if messaging fails.
    pub fn listen(&mut self, gated: &AtomicI64) -> Result<(), IpcError> {
        self.states.listen(gated)?;
        self.references.listen(gated)
    }

    /// Lets those in who have joined since.
    pub fn preloan(&mut self) {
        self.states.output.preloan();
        self.references.output.preloan();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_judged_by_what_is_done_when_it_is_read() {
        let gated = AtomicI64::new(-1);
        assert!(is_near(0, &gated) && is_near(2, &gated) && !is_near(-1, &gated) && !is_near(3, &gated));
        gated.store(5, Ordering::Release);
        assert!(is_near(8, &gated) && !is_near(9, &gated));
    }

    #[test]
    fn a_successor_starts_before_a_gap_that_somebody_waits_for() {
        let from = |ticks: &[i64], done| without_gap(ticks.iter().copied(), done);
        assert_eq!(from(&[], 5), None);
        assert_eq!(from(&[0, 1], -1), Some(1));
        assert_eq!(from(&[3, 4, 5, 6, 7], 5), Some(7));
        assert_eq!(from(&[3, 4, 5, 7], 5), Some(5), "6 was never said");
        assert_eq!(from(&[2, 4, 5, 6], 5), Some(6), "nobody needs 3 any more");
        assert_eq!(from(&[2, 3, 7], 5), Some(3));
    }
}
