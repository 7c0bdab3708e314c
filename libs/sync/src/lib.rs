//! Lock-free primitives of the stack: each a few atomics without system calls, so that `loom` can explore every
//! interleaving.
//!
//! | primitive | between | used by |
//! |---|---|---|
//! | [`DoorbellWord`] | a notifier and its waiters, across processes | `ipc`'s doorbells |
//! | [`DeadlineWord`] | a waiting thread and the helper thread that ends its wait | `ipc`'s deadline timer |
//! | [`VersionedCell`], [`GenerationCell`] | the writer of heartbeats and their readers | `gate/process`'s shared status |
//! | [`PendingId`] | the operator's server and the gate | `gate/process`'s change exchange |
//!
//! `tests/loom` holds the explorations; `just loom` runs them.

mod deadline_word;
mod doorbell_word;
mod generation_cell;
mod pending_id;
mod versioned_cell;

pub use deadline_word::DeadlineWord;
pub use doorbell_word::{DoorbellWord, WaiterGuard};
pub use generation_cell::GenerationCell;
pub use pending_id::PendingId;
pub use versioned_cell::VersionedCell;

/// Atomics: the standard library's, or loom's.
mod atomic {
    #[cfg(loom)]
    pub(crate) use loom::sync::atomic::{AtomicU32, AtomicU64, Ordering, fence};
    #[cfg(not(loom))]
    pub(crate) use std::sync::atomic::{AtomicU32, AtomicU64, Ordering, fence};
}

/// Hint in a loop that waits for another thread.
fn spin_loop() {
    #[cfg(loom)]
    loom::thread::yield_now();
    #[cfg(not(loom))]
    core::hint::spin_loop();
}
