//! Deadline that one thread arms and another thread fires.

use crate::atomic::{AtomicU64, Ordering};

/// Deadline: twice its time [ns], plus 1 while it is armed.
#[derive(Debug)]
pub struct DeadlineWord(AtomicU64);

impl Default for DeadlineWord {
    fn default() -> Self {
        Self(AtomicU64::new(0))
    }
}

impl DeadlineWord {
    /// Arms the deadline at a time of the monotonic clock [ns], in place of the previous one.
    pub fn arm(&self, when_ns: u64) {
        // A swap, so that all changes are read-modify-write operations, whose order loom models exactly.
        self.0.swap(when_ns * 2 + 1, Ordering::AcqRel);
    }

    /// Disarms the deadline; a deadline that has fired stays fired.
    pub fn disarm(&self) {
        self.0.fetch_and(!1, Ordering::AcqRel);
    }

    /// Whether the deadline is armed.
    #[must_use]
    pub fn is_armed(&self) -> bool {
        self.0.load(Ordering::Acquire) % 2 == 1
    }

    /// Fires the deadline if it is armed and due at `now_ns`. Returns its time [ns], and whether this call fired it.
    ///
    /// Each armed deadline fires at most once, and never after it was disarmed or replaced.
    #[must_use]
    pub fn fire_if_due(&self, now_ns: u64) -> (u64, bool) {
        let armed = self.0.load(Ordering::Acquire);
        let when = armed / 2;
        let fired = armed % 2 == 1
            && when <= now_ns
            && self.0.compare_exchange(armed, when * 2, Ordering::AcqRel, Ordering::Relaxed).is_ok();
        (when, fired)
    }
}
