//! State of the newest request: pending or closed.

use crate::atomic::{AtomicU64, Ordering};

/// Id of the newest request, and whether it is pending: the taker takes it or the owner withdraws it, never both.
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
    /// Makes a request pending, in place of the previous one. Only the owner may call it.
    pub fn open(&self, id: u64) {
        self.0.store(pending(id), Ordering::Release);
    }

    /// Takes a request. Returns `false` if it was withdrawn, replaced or taken before.
    #[must_use]
    pub fn take(&self, id: u64) -> bool {
        self.close(id)
    }

    /// Withdraws a request. Returns `false` if it was taken.
    #[must_use]
    pub fn withdraw(&self, id: u64) -> bool {
        self.close(id)
    }

    fn close(&self, id: u64) -> bool {
        self.0.compare_exchange(pending(id), closed(id), Ordering::AcqRel, Ordering::Acquire).is_ok()
    }
}
