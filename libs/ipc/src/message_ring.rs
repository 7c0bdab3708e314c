//! Rings of the last messages of each sender, in the run's folder.
//!
//! A sender writes a message here before it sends it, and the ring outlives the sender and everybody else: its successor
//! continues from there, and in lockstep a recorder finds here what its predecessor has not flushed. So nothing is lost,
//! whichever processes die together.

use crate::error::IpcError;
use crate::shared_page::SharedWords;
use crate::topic::Topic;
use core::marker::PhantomData;
use core::sync::atomic::{AtomicU64, Ordering, fence};
use hapfic_messages::{Clock, Message, Process};
use zerocopy::IntoBytes;

/// Words before the first place: the number of messages so far, alone on its cache line.
const HEADER: usize = 8;

/// The last messages of a sender. It has one writer at a time.
#[derive(Debug)]
pub(crate) struct MessageRing<T> {
    words: SharedWords,
    capacity: u64,
    kind: PhantomData<fn() -> T>,
}

impl<T: Message> MessageRing<T> {
    const WORDS: usize = size_of::<T>() / 8;

    /// Maps the ring of a sender in a run's folder, made if it is missing; `None` if nobody needs it with this clock.
    ///
    /// # Errors
    /// [`IpcError::System`] if it cannot be made or mapped.
    pub(crate) fn open(folder: &str, topic: &Topic<T>, sender: Process, clock: Clock) -> Result<Option<Self>, IpcError> {
        const { assert!(size_of::<T>().is_multiple_of(8)) };
        let capacity = match clock {
            Clock::Realtime => topic.kept_realtime,
            Clock::Lockstep => topic.kept_lockstep,
        };
        if capacity == 0 {
            return Ok(None);
        }
        let file = format!("sent-{}-{}", topic.name, sender.name());
        let words = SharedWords::open(folder, &file, HEADER + capacity * Self::WORDS, "keep the last messages of a sender")?;
        Ok(Some(Self { words, capacity: capacity as u64, kind: PhantomData }))
    }

    /// Prepares the ring for a writer that is a real-time thread.
    pub(crate) fn prefault_writes(&self) {
        self.words.prefault_writes();
    }

    fn place(&self, number: u64) -> &[AtomicU64] {
        let begin = HEADER + (number % self.capacity) as usize * Self::WORDS;
        &self.words[begin..begin + Self::WORDS]
    }

    /// Appends a message. A writer that is killed in between leaves the ring without it.
    pub(crate) fn push(&self, message: &T) {
        let number = self.words[0].load(Ordering::Relaxed);
        for (word, bytes) in self.place(number).iter().zip(message.as_bytes().as_chunks::<8>().0) {
            word.store(u64::from_ne_bytes(*bytes), Ordering::Relaxed);
        }
        self.words[0].store(number + 1, Ordering::Release);
    }

    /// The last messages, the oldest first: one less than the capacity, since a writer may be at the oldest place.
    pub(crate) fn read(&self) -> Vec<T> {
        self.read_last(u64::MAX)
    }

    /// The same, but at most `count`.
    fn read_last(&self, count: u64) -> Vec<T> {
        let end = self.words[0].load(Ordering::Acquire);
        let begin = end.saturating_sub(count.min(self.capacity - 1));
        let copy = |number| {
            let words: Vec<u64> = self.place(number).iter().map(|word| word.load(Ordering::Relaxed)).collect();
            T::read_from_bytes(words.as_bytes()).ok()
        };
        let mut messages: Vec<T> = (begin..end).filter_map(copy).collect();
        // What was written meanwhile has replaced the oldest.
        fence(Ordering::Acquire);
        let oldest = self.words[0].load(Ordering::Relaxed).saturating_sub(self.capacity - 1);
        messages.drain(..((oldest.saturating_sub(begin)) as usize).min(messages.len()));
        messages
    }
}

/// The last messages of a sender, living or dead, for a process that looks now and then.
#[derive(Debug)]
pub struct KeptMessages<T>(MessageRing<T>);

impl<T: Message> KeptMessages<T> {
    pub(crate) fn new(ring: MessageRing<T>) -> Self {
        Self(ring)
    }

    /// At most `count` of the last messages, the oldest first. They are not checked yet.
    #[must_use]
    pub fn last(&self, count: u32) -> Vec<T> {
        self.0.read_last(count.into())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::topic;
    use hapfic_messages::State;

    fn ticks(ring: &MessageRing<State>) -> Vec<i64> {
        ring.read().iter().map(|state| state.tick).collect()
    }

    #[test]
    fn ring_outlives_writer_and_keeps_the_last() {
        let folder = tempfile::tempdir().unwrap();
        let open =
            |clock| MessageRing::open(folder.path().to_str().unwrap(), &topic::STATE, Process::Plant, clock).unwrap().unwrap();
        let reader = open(Clock::Realtime);
        assert!(reader.read().is_empty());
        let capacity = topic::STATE.kept_realtime as i64;
        for tick in 0..3 * capacity {
            // Every writer is the successor of the one before.
            open(Clock::Realtime).push(&State { tick, slipped: 7, ..State::default() });
            let first = (tick + 2 - capacity).max(0);
            assert_eq!(ticks(&reader), (first..=tick).collect::<Vec<_>>());
            assert!(reader.read().iter().all(|state| state.slipped == 7));
        }
        let last: Vec<i64> = KeptMessages::new(reader).last(2).iter().map(|state| state.tick).collect();
        assert_eq!(last, [3 * capacity - 2, 3 * capacity - 1]);
    }

    #[test]
    fn ring_read_beside_writer_has_no_torn_message() {
        let folder = tempfile::tempdir().unwrap();
        let open = || MessageRing::open(folder.path().to_str().unwrap(), &topic::STATE, Process::Plant, Clock::Realtime);
        let (writer, reader) = (open().unwrap().unwrap(), open().unwrap().unwrap());
        std::thread::scope(|scope| {
            scope.spawn(move || {
                for tick in 0..20_000 {
                    writer.push(&State { tick, slipped: tick as u64, time_ns: tick as u64, ..State::default() });
                }
            });
            let mut newest = -1;
            while newest < 19_999 {
                for state in reader.read() {
                    assert_eq!((state.slipped, state.time_ns), (state.tick as u64, state.tick as u64));
                    newest = newest.max(state.tick);
                }
            }
        });
    }

    #[test]
    fn ring_of_topic_that_nobody_resumes_is_not_made() {
        let folder = tempfile::tempdir().unwrap();
        let open = |clock| MessageRing::open(folder.path().to_str().unwrap(), &topic::TIMING, Process::Plant, clock).unwrap();
        assert!(open(Clock::Realtime).is_none() && open(Clock::Lockstep).is_some());
    }
}
