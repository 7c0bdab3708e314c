//! Chains over the transports of the kernel.

mod datagram;
mod eventfd;
mod futex;
mod mailbox;

use crate::link::Kind;

/// Kinds of chain over the transports of the kernel, the fastest first.
#[must_use]
pub fn kernel_kinds() -> [&'static dyn Kind; 3] {
    [&futex::Futex, &eventfd::EventFd, &datagram::Datagram]
}
