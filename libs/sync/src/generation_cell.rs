//! Words of the present generation of a process: what its predecessor wrote never counts.

use crate::atomic::{AtomicU32, Ordering};
use crate::versioned_cell::VersionedCell;

/// Words tagged with the generation that wrote them; readers get those of the expected generation only.
///
/// `W` counts the words and the tag: `GenerationCell<4>` holds three words.
#[derive(Debug)]
pub struct GenerationCell<const W: usize> {
    expected: AtomicU32,
    cell: VersionedCell<W>,
}

impl<const W: usize> Default for GenerationCell<W> {
    fn default() -> Self {
        Self { expected: AtomicU32::new(0), cell: VersionedCell::default() }
    }
}

/// Tag of a generation; 0 is the tag of words that were never written.
fn tag(generation: u32) -> u64 {
    u64::from(generation) + 1
}

impl<const W: usize> GenerationCell<W> {
    /// Expects words of another generation from now on: those of the one before do not count any more. By any thread.
    pub fn expect(&self, generation: u32) {
        self.expected.store(generation, Ordering::Release);
    }

    /// Writes the words of a generation; the first word is replaced by its tag. By one thread only. Words of another generation than
    /// the expected one are kept out of readers' sight.
    pub fn write(&self, generation: u32, mut words: [u64; W]) {
        words[0] = tag(generation);
        self.cell.write(words);
    }

    /// The newest words, if the expected generation wrote them; the first is its tag.
    #[must_use]
    pub fn read(&self) -> Option<[u64; W]> {
        let words = self.cell.read();
        (words[0] == tag(self.expected.load(Ordering::Acquire))).then_some(words)
    }
}
