//! The hand-over cache: the last states and references, for the successor of a lost process.
//!
//! The history of a publisher ends with its process. So the supervisor subscribes too, and republishes the last
//! messages of a lost process. The successor continues from there; later subscribers find them in the history.

use anyhow::Result;
use hapfic_ipc::topic::{self, Topic};
use hapfic_ipc::{Bus, Input, IpcError, Output, Wait};
use hapfic_messages::{Check, Message, Operator, Process, Reference, State, TickBuffer, Ticked};
use std::sync::atomic::{AtomicI64, Ordering};

/// Ticks that a message may be ahead of the last command: the planner is one tick ahead, its state another.
const MAX_TICKS_AHEAD: i64 = 3;

/// Cached topic.
struct CachedTopic<T: Message> {
    input: Input<T>,
    output: Output<T>,
    recent: TickBuffer<T>,
}

impl<T: Check + Ticked + Message> CachedTopic<T> {
    fn open(bus: &Bus, topic: &Topic<T>) -> Result<Self, IpcError> {
        Ok(Self { input: bus.input(topic, Wait::No)?, output: bus.output(topic)?, recent: TickBuffer::default() })
    }

    /// Receives new messages.
    fn receive(&mut self, gated: &AtomicI64) -> Result<(), IpcError> {
        while let Some(message) = self.input.next()? {
            // Republished messages come back here too; a corrupt message must not become a successor's start.
            if message.check().is_ok() && is_near(message.tick(), gated) {
                self.recent.insert(message);
            }
        }
        Ok(())
    }

    /// Republishes the last messages, oldest first.
    ///
    /// Returns the newest tick before which no needed tick is missing; `None` if there are no messages.
    fn hand_over(&mut self, gated: &AtomicI64) -> Result<Option<i64>, IpcError> {
        self.receive(gated)?;
        let done = gated.load(Ordering::Acquire);
        let mut last: Vec<T> = self.recent.iter().copied().collect();
        last.sort_by_key(Ticked::tick);
        for message in &last {
            self.output.send(message)?;
            self.output.preloan();
        }
        Ok(newest_without_gap(last.iter().map(Ticked::tick), done))
    }
}

/// Whether a received message can be recent: a tick further ahead is invalid.
///
/// The last command's tick is read after the message. Read before, it may be outdated when the thread was preempted in
/// between, and valid messages would be dropped.
fn is_near(tick: i64, gated: &AtomicI64) -> bool {
    (0..=gated.load(Ordering::Acquire) + MAX_TICKS_AHEAD).contains(&tick)
}

/// Returns the newest of the ascending `ticks` without a gap between it and the last tick `done`.
fn newest_without_gap(ticks: impl Iterator<Item = i64>, done: i64) -> Option<i64> {
    let mut newest = None;
    for tick in ticks {
        match newest {
            Some(before) if tick > done && tick != before + 1 => break,
            _ => newest = Some(tick),
        }
    }
    newest
}

/// Cache of the last states and references, and the parameter sets published last.
pub struct HandOverCache {
    states: CachedTopic<State>,
    references: CachedTopic<Reference>,
    operators: Input<Operator>,
    /// Parameter sets published last.
    sets: Option<Operator>,
}

impl HandOverCache {
    /// Subscribes to the topics. The call comes before any process publishes.
    ///
    /// # Errors
    /// [`IpcError`] if the topics cannot be opened.
    pub fn open(bus: &Bus) -> Result<Self, IpcError> {
        Ok(Self {
            states: CachedTopic::open(bus, &topic::STATE)?,
            references: CachedTopic::open(bus, &topic::REFERENCE)?,
            operators: bus.input(&topic::OPERATOR, Wait::No)?,
            sets: None,
        })
    }

    /// Republishes the last messages of a lost process.
    ///
    /// Returns the tick from which its successor continues; `None` without history, as always for controllers.
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

    /// Receives new messages. The caller does this often, and before it cleans up dead nodes.
    ///
    /// The clean-up of a dead process removes its unread messages, unless the connection was made while it lived.
    ///
    /// # Errors
    /// [`IpcError`] if messaging fails.
    pub fn receive(&mut self, gated: &AtomicI64) -> Result<(), IpcError> {
        self.states.receive(gated)?;
        self.references.receive(gated)?;
        self.receive_operators()
    }

    fn receive_operators(&mut self) -> Result<(), IpcError> {
        while let Some(sets) = self.operators.next()? {
            if sets.check().is_ok() && self.sets.is_none_or(|last| sets.next.version >= last.next.version) {
                self.sets = Some(sets);
            }
        }
        Ok(())
    }

    /// Parameter sets published last; `None` before the first.
    pub fn operator(&self) -> Option<Operator> {
        self.sets
    }

    /// The newest state, with the reference of its tick if that is there.
    pub fn newest(&self) -> Option<(&State, Option<&Reference>)> {
        let state = self.states.recent.newest()?;
        Some((state, self.references.recent.at(state.tick)))
    }

    /// Updates the connections, for subscribers that have started since.
    pub fn preloan(&mut self) {
        self.states.output.preloan();
        self.references.output.preloan();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_near_gate_advances_accepts_later_tick() {
        let gated = AtomicI64::new(-1);
        assert!(is_near(0, &gated) && is_near(2, &gated) && !is_near(-1, &gated) && !is_near(3, &gated));
        gated.store(5, Ordering::Release);
        assert!(is_near(8, &gated) && !is_near(9, &gated));
    }

    #[test]
    fn newest_without_gap_missing_needed_tick_stops_before_it() {
        let from = |ticks: &[i64], done| newest_without_gap(ticks.iter().copied(), done);
        assert_eq!(from(&[], 5), None);
        assert_eq!(from(&[0, 1], -1), Some(1));
        assert_eq!(from(&[3, 4, 5, 6, 7], 5), Some(7));
        assert_eq!(from(&[3, 4, 5, 7], 5), Some(5), "6 was never published");
        assert_eq!(from(&[2, 4, 5, 6], 5), Some(6), "3 is not needed any more");
        assert_eq!(from(&[2, 3, 7], 5), Some(3));
    }
}
