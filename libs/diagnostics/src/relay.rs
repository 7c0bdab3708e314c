//! The process at place 1 or 2 of a chain: passes on what comes.
#![allow(unsafe_code)]

use crate::arguments::RelayWords;
use crate::error::LatencyError;
use crate::link::{Kind, Link, PLACES, Seat};
use hapfic_ipc::Ending;
use hapfic_ipc::realtime::{self, Prefault, SchedGrants, SchedRequest};
use std::io;
use std::os::fd::{FromRawFd, OwnedFd};

/// Takes each message that comes, and sends one of `size` bytes with as much of its content; does not return but with an error.
///
/// # Errors
/// Of the link.
pub fn relay(link: &mut dyn Link, size: usize, longest: usize) -> io::Result<std::convert::Infallible> {
    let (mut into, mut out) = (vec![1; longest], vec![1; size]);
    loop {
        let length = link.receive(&mut into, None)?.min(size);
        // A wait for ever that ends without a message was woken for nothing.
        if length > 0 {
            out[..length].copy_from_slice(&into[..length]);
            link.send(&out)?;
        }
    }
}

/// Joins the chain and relays until the driver ends; `ready` is called with what was granted once it has joined.
pub(crate) fn serve(kind: &dyn Kind, words: &RelayWords, ready: impl FnOnce(SchedGrants)) -> Result<(), LatencyError> {
    let name = kind.name();
    hapfic_ipc::tie_to_supervisor(words.driver, Ending::Killed).map_err(LatencyError::failed(name, "join the driver"))?;
    let sizes: Vec<usize> = words.sizes.iter().map(|bytes| *bytes as usize).collect();
    let sizes: [usize; PLACES] = sizes
        .try_into()
        .map_err(|found: Vec<_>| LatencyError::Arguments(format!("--sizes: found {} values, expected {PLACES}", found.len())))?;
    let mut shared: Vec<OwnedFd> = Vec::new();
    for descriptor in &words.shared {
        std::fs::symlink_metadata(format!("/proc/self/fd/{descriptor}"))
            .map_err(LatencyError::failed(name, "take over a file"))?;
        // SAFETY: it is open; the driver has left it so for this process alone to own, which has opened nothing else yet that it
        // keeps, and so nothing by this number.
        shared.push(unsafe { OwnedFd::from_raw_fd(*descriptor) });
    }
    let mut granted = SchedGrants::default();
    if words.priority > 0 {
        realtime::lock_memory(Prefault::Used);
        granted = realtime::apply_to_current_thread(SchedRequest::new(words.priority, words.core.0));
    }
    let seat = Seat { place: words.place as usize, sizes, chain: words.chain.clone(), shared };
    let (size, longest) = (sizes[seat.place], seat.longest());
    let mut link = kind.join(seat).map_err(LatencyError::failed(name, "join the chain"))?;
    ready(granted);
    match relay(link.as_mut(), size, longest) {
        Ok(never) => match never {},
        Err(cause) => Err(LatencyError::Failed { kind: name.to_owned(), action: "relay", cause }),
    }
}
