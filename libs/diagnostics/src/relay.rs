//! Process at stage 1 or 2 of a chain: forwards each message.
#![allow(unsafe_code)]

use crate::arguments::RelayArguments;
use crate::error::LatencyError;
use crate::link::{Kind, Link, STAGES, Seat};
use hapfic_ipc::realtime::{self, Prefault, SchedGrants, SchedRequest};
use std::io;
use std::os::fd::{FromRawFd, OwnedFd};

/// Receives each message, and sends one of `size` bytes with as much of its content; returns only an error.
///
/// # Errors
/// The error of the link.
pub fn relay(link: &mut dyn Link, size: usize, longest: usize) -> io::Result<std::convert::Infallible> {
    let (mut into, mut out) = (vec![1; longest], vec![1; size]);
    loop {
        let length = link.receive(&mut into, None)?.min(size);
        // A length of 0 is a spurious wake-up.
        if length > 0 {
            out[..length].copy_from_slice(&into[..length]);
            link.send(&out)?;
        }
    }
}

/// Joins the chain, calls `ready` with the scheduling grants, and relays until the driver ends.
pub(crate) fn serve(kind: &dyn Kind, arguments: &RelayArguments, ready: impl FnOnce(SchedGrants)) -> Result<(), LatencyError> {
    let name = kind.name();
    hapfic_ipc::tie_to_parent(arguments.driver).map_err(LatencyError::failed(name, "be tied to the driver"))?;
    let sizes: Vec<usize> = arguments.sizes.iter().map(|bytes| *bytes as usize).collect();
    let sizes: [usize; STAGES] = sizes
        .try_into()
        .map_err(|found: Vec<_>| LatencyError::Arguments(format!("--sizes: found {} values, expected {STAGES}", found.len())))?;
    let mut shared: Vec<OwnedFd> = Vec::new();
    for descriptor in &arguments.shared {
        std::fs::symlink_metadata(format!("/proc/self/fd/{descriptor}")).map_err(LatencyError::failed(name, "inherit a file"))?;
        // SAFETY: the descriptor is open, and inherited for this process alone to own; this process keeps no other file
        // open yet, so none with this number.
        shared.push(unsafe { OwnedFd::from_raw_fd(*descriptor) });
    }
    let mut granted = SchedGrants::default();
    if arguments.priority > 0 {
        realtime::lock_memory(Prefault::Used);
        granted = realtime::apply_to_current_thread(SchedRequest::new(arguments.priority, arguments.core.0));
    }
    let seat = Seat { stage: arguments.stage as usize, sizes, chain: arguments.chain.clone(), shared };
    let (size, longest) = (sizes[seat.stage], seat.longest());
    let mut link = kind.join(seat).map_err(LatencyError::failed(name, "join the chain"))?;
    ready(granted);
    match relay(link.as_mut(), size, longest) {
        Ok(never) => match never {},
        Err(cause) => Err(LatencyError::Failed { kind: name.to_owned(), action: "relay", cause }),
    }
}
