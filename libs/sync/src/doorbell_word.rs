//! Sequence number with waiters: the shared-memory part of a futex notifier.

use crate::atomic::{AtomicU32, Ordering};

/// Sequence number and waiters of one doorbell, on a cache line of its own.
///
/// A notifier increments the sequence and wakes the waiters, if there are any. A waiter registers itself, and sleeps
/// only while the sequence is the one it has seen last. Both orders are sequentially consistent: either the notifier
/// sees the waiter, or the waiter sees the new sequence. A process that dies while it sleeps leaves `waiters` too high;
/// each notification then makes its system call.
#[derive(Debug)]
#[repr(C, align(64))]
pub struct DoorbellWord {
    sequence: AtomicU32,
    waiters: AtomicU32,
    polled: AtomicU32,
}

impl Default for DoorbellWord {
    fn default() -> Self {
        Self { sequence: AtomicU32::new(0), waiters: AtomicU32::new(0), polled: AtomicU32::new(0) }
    }
}

impl DoorbellWord {
    /// Increments the sequence; calls `wake` with it if there are waiters. Earlier writes are visible to every thread
    /// that sees it.
    pub fn notify(&self, wake: impl FnOnce(&AtomicU32)) {
        self.sequence.fetch_add(1, Ordering::SeqCst);
        loom_fence();
        if self.waiters.load(Ordering::SeqCst) != 0 {
            wake(&self.sequence);
        }
    }

    /// Notifications so far, modulo 2^32.
    #[must_use]
    pub fn sequence(&self) -> u32 {
        self.sequence.load(Ordering::SeqCst)
    }

    /// Futex word of the waiters.
    #[must_use]
    pub fn futex(&self) -> &AtomicU32 {
        &self.sequence
    }

    /// Whether a notification would make its system call.
    #[must_use]
    pub fn has_waiters(&self) -> bool {
        self.waiters.load(Ordering::SeqCst) != 0
    }

    /// Whether a thread polls the sequence and need not be woken.
    #[must_use]
    pub fn is_polled(&self) -> bool {
        self.polled.load(Ordering::Relaxed) != 0
    }

    /// Marks the sequence as polled, or not.
    pub fn set_polled(&self, polled: bool) {
        self.polled.store(u32::from(polled), Ordering::Relaxed);
    }

    /// Registers a waiter until the guard drops.
    #[must_use]
    pub fn register(&self) -> WaiterGuard<'_> {
        self.waiters.fetch_add(1, Ordering::SeqCst);
        loom_fence();
        WaiterGuard(self)
    }
}

/// Orders the operations before it with those after it, for loom, which models sequential consistency on fences alone.
fn loom_fence() {
    #[cfg(loom)]
    loom::sync::atomic::fence(Ordering::SeqCst);
}

/// Registration of a thread that sleeps, or is about to sleep.
#[derive(Debug)]
pub struct WaiterGuard<'a>(&'a DoorbellWord);

impl Drop for WaiterGuard<'_> {
    fn drop(&mut self) {
        self.0.waiters.fetch_sub(1, Ordering::SeqCst);
    }
}
