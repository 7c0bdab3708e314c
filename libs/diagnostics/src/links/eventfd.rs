//! Messages in shared memory, woken through an eventfd: what can be waited for together with other files.

use super::mailbox::Mailboxes;
use crate::link::{Kind, Link, PLACES, Seat};
use hapfic_ipc::clock;
use rustix::event::{EventfdFlags, PollFd, PollFlags, eventfd, poll};
use rustix::io::Errno;
use std::io;
use std::os::fd::OwnedFd;
use std::time::Duration;

/// The kind of chain.
pub(super) struct EventFd;

impl Kind for EventFd {
    fn name(&self) -> &'static str {
        "eventfd"
    }

    fn prepare(&self, sizes: &[usize; PLACES]) -> io::Result<Vec<OwnedFd>> {
        let mut shared = vec![Mailboxes::make(sizes)?];
        for _ in 0..PLACES {
            shared.push(eventfd(0, EventfdFlags::CLOEXEC)?);
        }
        Ok(shared)
    }

    fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>> {
        let found = seat.shared.len();
        let (from, place) = (seat.before(), seat.place);
        let [memory, doorbells @ ..] = seat.shared.as_slice() else {
            return Err(io::Error::other("the shared memory was not handed over"));
        };
        let (Some(ring), Some(doorbell)) = (doorbells.get(place), doorbells.get(from)) else {
            return Err(io::Error::other(format!("found {found} files handed over, expected {}", PLACES + 1)));
        };
        let (ring, doorbell) = (ring.try_clone()?, doorbell.try_clone()?);
        let boxes = Mailboxes::open(memory, &seat)?;
        Ok(Box::new(Joined { boxes, ring, doorbell, to: place, from, last: 0 }))
    }
}

struct Joined {
    boxes: Mailboxes,
    ring: OwnedFd,
    doorbell: OwnedFd,
    to: usize,
    from: usize,
    last: u32,
}

impl Link for Joined {
    fn send(&mut self, message: &[u8]) -> io::Result<()> {
        self.boxes.put(self.to, message)?;
        rustix::io::write(&self.ring, &1_u64.to_ne_bytes())?;
        Ok(())
    }

    fn receive(&mut self, into: &mut [u8], timeout: Option<Duration>) -> io::Result<usize> {
        let end = timeout.map(|timeout| clock::now_ns() + timeout.as_nanos() as u64);
        loop {
            if let Some(end) = end {
                let left = end.saturating_sub(clock::now_ns());
                let ready = poll(&mut [PollFd::new(&self.doorbell, PollFlags::IN)], Some(&clock::timespec(left)));
                match ready {
                    Ok(0) if left == 0 => return Ok(0),
                    Ok(0) | Err(Errno::INTR) => continue,
                    Ok(_) => {}
                    Err(e) => return Err(e.into()),
                }
            }
            match rustix::io::read(&self.doorbell, &mut [0_u8; 8]) {
                Ok(_) | Err(Errno::INTR) => {}
                Err(e) => return Err(e.into()),
            }
            if let Some(length) = self.boxes.take(self.from, &mut self.last, into)? {
                return Ok(length);
            }
        }
    }
}
