//! Messages in shared memory, with an eventfd as notifier, which `poll` can wait for together with other files.

use super::mailbox::Mailboxes;
use crate::link::{Kind, Link, STAGES, Seat};
use hapfic_ipc::clock;
use rustix::event::{EventfdFlags, PollFd, PollFlags, eventfd, poll};
use rustix::io::Errno;
use std::io;
use std::os::fd::OwnedFd;
use std::time::Duration;

/// Kind of chain over shared memory and eventfds.
pub(super) struct EventFd;

impl Kind for EventFd {
    fn name(&self) -> &'static str {
        "eventfd"
    }

    fn prepare(&self, sizes: &[usize; STAGES]) -> io::Result<Vec<OwnedFd>> {
        let mut shared = vec![Mailboxes::make(sizes)?];
        for _ in 0..STAGES {
            shared.push(eventfd(0, EventfdFlags::CLOEXEC)?);
        }
        Ok(shared)
    }

    fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>> {
        let found = seat.shared.len();
        let (from, stage) = (seat.before(), seat.stage);
        let [memory, notifiers @ ..] = seat.shared.as_slice() else {
            return Err(io::Error::other("found no inherited shared memory, expected one file"));
        };
        let (Some(to_notifier), Some(from_notifier)) = (notifiers.get(stage), notifiers.get(from)) else {
            return Err(io::Error::other(format!("found {found} inherited files, expected {}", STAGES + 1)));
        };
        let (to_notifier, from_notifier) = (to_notifier.try_clone()?, from_notifier.try_clone()?);
        let mailboxes = Mailboxes::open(memory, &seat)?;
        Ok(Box::new(EventFdLink { mailboxes, to_notifier, from_notifier, to: stage, from, last: 0 }))
    }
}

struct EventFdLink {
    mailboxes: Mailboxes,
    to_notifier: OwnedFd,
    from_notifier: OwnedFd,
    to: usize,
    from: usize,
    last: u32,
}

impl Link for EventFdLink {
    fn send(&mut self, message: &[u8]) -> io::Result<()> {
        self.mailboxes.put(self.to, message)?;
        rustix::io::write(&self.to_notifier, &1_u64.to_ne_bytes())?;
        Ok(())
    }

    fn receive(&mut self, into: &mut [u8], timeout: Option<Duration>) -> io::Result<usize> {
        let end = timeout.map(|timeout| clock::now_ns() + timeout.as_nanos() as u64);
        loop {
            if let Some(end) = end {
                let left = end.saturating_sub(clock::now_ns());
                let ready = poll(&mut [PollFd::new(&self.from_notifier, PollFlags::IN)], Some(&clock::timespec(left)));
                match ready {
                    Ok(0) if left == 0 => return Ok(0),
                    Ok(0) | Err(Errno::INTR) => continue,
                    Ok(_) => {}
                    Err(e) => return Err(e.into()),
                }
            }
            match rustix::io::read(&self.from_notifier, &mut [0_u8; 8]) {
                Ok(_) | Err(Errno::INTR) => {}
                Err(e) => return Err(e.into()),
            }
            if let Some(length) = self.mailboxes.take(self.from, &mut self.last, into)? {
                return Ok(length);
            }
        }
    }
}
