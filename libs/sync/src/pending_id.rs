//! Whether the newest request still waits to be taken.

use crate::atomic::{AtomicU64, Ordering};

/// The newest request's id, and whether it is pending: either its taker takes it or its owner withdraws it, never both.
#[derive(Debug)]
pub struct PendingId(AtomicU64);

const fn pending(id: u64) -> u64 {
    2 * id
}

const fn closed(id: u64) -> u64 {
    2 * id + 1
}

impl Default for PendingId {
    fn default() -> Self {
        Self(AtomicU64::new(closed(0)))
    }
}

impl PendingId {
    /// Makes a request pending, instead of the one before. By its owner.
    pub fn open(&self, id: u64) {
        self.0.store(pending(id), Ordering::Release);
    }

    /// Takes a request. `false` if it was withdrawn, replaced or taken before.
    #[must_use]
    pub fn take(&self, id: u64) -> bool {
        self.close(id)
    }

    /// Withdraws a request. `false` if it was taken.
    #[must_use]
    pub fn withdraw(&self, id: u64) -> bool {
        self.close(id)
    }

    fn close(&self, id: u64) -> bool {
        self.0.compare_exchange(pending(id), closed(id), Ordering::AcqRel, Ordering::Acquire).is_ok()
    }
}
