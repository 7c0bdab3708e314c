//! Words that readers get as one write stored them.

use crate::atomic::{AtomicU64, Ordering, fence};
use crate::spin_loop;

/// `N` words with a version, written by one thread and read by many.
///
/// Writes alternate between two slots: a writer that is preempted during a write disturbs no reader. A reader repeats
/// only if the writer has begun its second write meanwhile.
#[derive(Debug)]
#[repr(C)]
pub struct VersionedCell<const N: usize> {
    version: AtomicU64,
    slots: [[AtomicU64; N]; 2],
}

impl<const N: usize> Default for VersionedCell<N> {
    fn default() -> Self {
        let slot = || core::array::from_fn(|_| AtomicU64::new(0));
        Self { version: AtomicU64::new(0), slots: [slot(), slot()] }
    }
}

impl<const N: usize> VersionedCell<N> {
    /// Writes all words. Only one thread may call it.
    pub fn write(&self, words: [u64; N]) {
        let next = self.version.load(Ordering::Relaxed) + 1;
        // A reader that sees one of these words sees the version before it, too.
        fence(Ordering::Release);
        for (slot, word) in self.slots[(next % 2) as usize].iter().zip(words) {
            slot.store(word, Ordering::Relaxed);
        }
        self.version.store(next, Ordering::Release);
    }

    /// Words of one write: the newest, or the one that was newest at the call. All zero before the first.
    #[must_use]
    pub fn read(&self) -> [u64; N] {
        loop {
            let version = self.version.load(Ordering::Acquire);
            let words = core::array::from_fn(|i| self.slots[(version % 2) as usize][i].load(Ordering::Relaxed));
            fence(Ordering::Acquire);
            if self.version.load(Ordering::Relaxed) == version {
                return words;
            }
            spin_loop();
        }
    }
}
