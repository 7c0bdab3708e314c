//! Words of the present generation of a process: those of its predecessor never count.

use crate::atomic::{AtomicU32, Ordering};
use crate::versioned_cell::VersionedCell;

/// Words tagged with the generation that wrote them; readers get those of the expected generation only.
///
/// `W` counts the words and the tag: `GenerationCell<4>` holds three words.
#[derive(Debug)]
#[repr(C)]
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
    /// Expects words of another generation from now on: those of the previous generation no longer count. Any thread
    /// may call it.
    pub fn expect(&self, generation: u32) {
        self.expected.store(generation, Ordering::Release);
    }

    /// Writes the words of a generation; the first word is replaced by its tag. Only one thread may call it.
    ///
    /// Readers do not see words of a generation that is not expected.
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
