//! Page of the recorder in the run's folder: what supervisor and recorder tell each other without messages.
//!
//! The page outlives every recorder, so a successor knows from it how far its predecessor has come.

use crate::error::IpcError;
use crate::shared_page::{PageContent, SharedPage};
use core::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use hapfic_messages::Process;

/// Name of the page in the run's folder.
const FILE: &str = "recorder";
/// Topics whose messages are numbered by ticks: states, references, both controllers' requests, commands.
pub const TICKED: usize = 5;
/// Identities of events that are kept.
const EVENTS: usize = 1024;

/// How far a log has come: what is flushed survives its recorder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LogPosition {
    /// Number of the present part; 0 before the first flush.
    pub part: u32,
    /// Size of the present part [bytes].
    pub bytes: u64,
    /// Newest tick of states, references, requests of `controller` and of `standby`, commands; -1 before the first.
    pub ticks: [i64; TICKED],
    /// Newest wake-up in the timing of each process [ns].
    pub timing_ns: [u64; Process::ALL.len()],
    /// Number of events.
    pub events: u64,
}

impl Default for LogPosition {
    fn default() -> Self {
        Self { part: 0, bytes: 0, ticks: [-1; TICKED], timing_ns: [0; Process::ALL.len()], events: 0 }
    }
}

/// A position word by word.
#[derive(Debug)]
#[repr(C)]
struct Position {
    part: AtomicU64,
    bytes: AtomicU64,
    /// Ticks, each plus one.
    ticks: [AtomicU64; TICKED],
    timing_ns: [AtomicU64; Process::ALL.len()],
    events: AtomicU64,
}

impl Position {
    fn store(&self, position: &LogPosition) {
        self.part.store(position.part.into(), Ordering::Relaxed);
        self.bytes.store(position.bytes, Ordering::Relaxed);
        for (word, tick) in self.ticks.iter().zip(position.ticks) {
            word.store((tick + 1) as u64, Ordering::Relaxed);
        }
        for (word, ns) in self.timing_ns.iter().zip(position.timing_ns) {
            word.store(ns, Ordering::Relaxed);
        }
        self.events.store(position.events, Ordering::Release);
    }

    fn load(&self) -> LogPosition {
        let events = self.events.load(Ordering::Acquire);
        LogPosition {
            part: self.part.load(Ordering::Relaxed) as u32,
            bytes: self.bytes.load(Ordering::Relaxed),
            ticks: core::array::from_fn(|i| self.ticks[i].load(Ordering::Relaxed) as i64 - 1),
            timing_ns: core::array::from_fn(|i| self.timing_ns[i].load(Ordering::Relaxed)),
            events,
        }
    }
}

#[derive(Debug)]
#[repr(C)]
struct Content {
    drain: AtomicU32,
    log_failed: AtomicU32,
    rounds: AtomicU64,
    written: AtomicU64,
    /// Positions of the last two flushes; the index of the newer is stored last, so that a recorder killed in between
    /// leaves a whole one.
    flushed: [Position; 2],
    newer: AtomicU32,
    events: [AtomicU64; EVENTS],
}

// SAFETY: atomics only, and zero stands for nothing received, written and kept.
unsafe impl PageContent for Content {}

/// The page of a run's recorder.
#[derive(Debug)]
pub struct RecorderPage(SharedPage<Content>);

impl RecorderPage {
    /// Maps the page in a run's folder; creates it if it is missing.
    ///
    /// # Errors
    /// [`IpcError::System`] if that fails.
    pub fn open(folder: &str) -> Result<Self, IpcError> {
        SharedPage::open(folder, FILE, "share the page of the recorder").map(Self)
    }

    /// Maps a page that only this process sees.
    ///
    /// # Errors
    /// [`IpcError::System`] without memory.
    pub fn private() -> Result<Self, IpcError> {
        SharedPage::private().map(Self)
    }

    /// Orders the recorder to receive the remaining messages and to end.
    pub fn order_drain(&self) {
        self.0.drain.store(1, Ordering::Release);
    }

    /// Whether the recorder has to receive the remaining messages and end.
    #[must_use]
    pub fn drain_ordered(&self) -> bool {
        self.0.drain.load(Ordering::Acquire) != 0
    }

    /// Notes that the log cannot be written any further.
    pub fn set_log_failed(&self) {
        self.0.log_failed.store(1, Ordering::Release);
    }

    /// Whether the log cannot be written any further.
    #[must_use]
    pub fn log_failed(&self) -> bool {
        self.0.log_failed.load(Ordering::Acquire) != 0
    }

    /// Counts a round in which the recorder has received all messages.
    pub fn count_round(&self) {
        self.0.rounds.fetch_add(1, Ordering::Release);
    }

    /// Rounds so far.
    #[must_use]
    pub fn rounds(&self) -> u64 {
        self.0.rounds.load(Ordering::Acquire)
    }

    /// Counts a message that the writer has taken up.
    pub fn count_written(&self) {
        self.0.written.fetch_add(1, Ordering::Relaxed);
    }

    /// Messages that the writer has taken up so far.
    #[must_use]
    pub fn written(&self) -> u64 {
        self.0.written.load(Ordering::Relaxed)
    }

    /// Notes the position that a completed flush has reached. Only the recorder may call it.
    pub fn set_flushed(&self, position: &LogPosition) {
        let next = 1 - self.0.newer.load(Ordering::Relaxed) % 2;
        self.0.flushed[next as usize].store(position);
        self.0.newer.store(next, Ordering::Release);
    }

    /// Position of the last completed flush. While a recorder flushes, its parts may be of two flushes.
    #[must_use]
    pub fn flushed(&self) -> LogPosition {
        self.0.flushed[self.0.newer.load(Ordering::Acquire) as usize % 2].load()
    }

    /// Notes the identity of an event by its number in the log.
    pub fn set_event(&self, number: u64, identity: u64) {
        self.0.events[number as usize % EVENTS].store(identity, Ordering::Relaxed);
    }

    /// Identities of the events from one number to another, the oldest of many left out.
    pub fn events(&self, from: u64, to: u64) -> impl Iterator<Item = u64> {
        (from.max(to.saturating_sub(EVENTS as u64))..to)
            .map(|number| self.0.events[number as usize % EVENTS].load(Ordering::Relaxed))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn position_reaches_other_process_after_flush() {
        let folder = tempfile::tempdir().unwrap();
        let open = || RecorderPage::open(folder.path().to_str().unwrap()).unwrap();
        let (recorder, supervisor) = (open(), open());
        assert_eq!(supervisor.flushed(), LogPosition::default());
        let position = LogPosition { part: 1, bytes: 9, ticks: [4, 5, 4, -1, 3], timing_ns: [0, 7, 0, 0, 9, 0, 3, 4], events: 2 };
        recorder.set_event(0, 11);
        recorder.set_event(1, 12);
        for part in 1..4 {
            recorder.set_flushed(&LogPosition { part, ..position });
            assert_eq!(supervisor.flushed(), LogPosition { part, ..position });
        }
        assert_eq!(supervisor.events(0, 2).collect::<Vec<_>>(), [11, 12]);
        assert_eq!(supervisor.events(0, 2 + EVENTS as u64).count(), EVENTS, "the oldest are lost");
    }
}
