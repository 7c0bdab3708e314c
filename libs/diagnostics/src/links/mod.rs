//! The chains over what the kernel itself offers.

mod datagram;
mod eventfd;
mod futex;
mod mailbox;

use crate::link::Kind;

/// The kinds of this crate, the leanest first.
#[must_use]
pub fn own() -> [&'static dyn Kind; 3] {
    [&futex::Futex, &eventfd::EventFd, &datagram::Datagram]
}
