//! What a plant remembers beside its published states, in the run's folder: it outlives the plant, and its successor
//! continues from it.
//!
//! A few ticks are kept, since a plant may die between keeping a tick and publishing its state.

use crate::error::IpcError;
use crate::shared_page::SharedWords;
use core::sync::atomic::Ordering;

/// Name of the file in the run's folder.
const FILE: &str = "plant-memory";
/// Ticks that are kept.
const SLOTS: usize = 4;
/// Words of a slot: tick plus one, length in bytes, and the content.
const CONTENT: usize = (512 << 10) / 8;
const SLOT: usize = 2 + CONTENT;

/// The memory of the plant. It has one writer at a time.
#[derive(Debug)]
pub struct PlantMemory(SharedWords);

impl PlantMemory {
    /// Largest content of a tick [bytes].
    pub const LARGEST: usize = CONTENT * 8;

    /// Maps the memory in a run's folder, made if it is missing.
    ///
    /// # Errors
    /// [`IpcError::System`] if it cannot be made or mapped.
    pub fn open(folder: &str) -> Result<Self, IpcError> {
        let words = SharedWords::open(folder, FILE, SLOTS * SLOT, "keep the memory of the plant")?;
        words.prefault_writes();
        Ok(Self(words))
    }

    fn slot(&self, tick: i64) -> &[core::sync::atomic::AtomicU64] {
        let begin = tick.rem_euclid(SLOTS as i64) as usize * SLOT;
        &self.0[begin..begin + SLOT]
    }

    /// Keeps what the plant remembers at a tick, before its state is published; more than [`LARGEST`](Self::LARGEST) bytes are
    /// not kept.
    pub fn keep(&self, tick: i64, bytes: &[u8]) {
        let slot = self.slot(tick);
        slot[0].store(0, Ordering::Relaxed);
        if bytes.len() > Self::LARGEST {
            return;
        }
        core::sync::atomic::fence(Ordering::Release);
        for (word, chunk) in slot[2..].iter().zip(bytes.chunks(8)) {
            let mut padded = [0; 8];
            padded[..chunk.len()].copy_from_slice(chunk);
            word.store(u64::from_ne_bytes(padded), Ordering::Relaxed);
        }
        slot[1].store(bytes.len() as u64, Ordering::Relaxed);
        slot[0].store(tick as u64 + 1, Ordering::Release);
    }

    /// What a dead plant remembered at a tick; `None` if it is not kept.
    #[must_use]
    pub fn of(&self, tick: i64) -> Option<Vec<u8>> {
        let slot = self.slot(tick);
        if slot[0].load(Ordering::Acquire) != tick as u64 + 1 {
            return None;
        }
        let length = (slot[1].load(Ordering::Relaxed) as usize).min(Self::LARGEST);
        let words = slot[2..].iter().take(length.div_ceil(8));
        let mut bytes: Vec<u8> = words.flat_map(|word| word.load(Ordering::Relaxed).to_ne_bytes()).collect();
        bytes.truncate(length);
        Some(bytes)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn memory_outlives_its_writer_for_some_ticks() {
        let folder = tempfile::tempdir().unwrap();
        let open = || PlantMemory::open(folder.path().to_str().unwrap()).unwrap();
        assert_eq!(open().of(0), None);
        for tick in 0..10_i64 {
            open().keep(tick, &vec![tick as u8; 100 + tick as usize]);
        }
        let successor = open();
        assert_eq!(successor.of(9), Some(vec![9; 109]));
        assert_eq!(successor.of(7), Some(vec![7; 107]));
        assert_eq!([5, 10].map(|tick| successor.of(tick)), [None, None]);
        successor.keep(10, &vec![0; PlantMemory::LARGEST + 1]);
        assert_eq!(successor.of(10), None, "too large");
    }
}
