//! Messages in shared memory, woken by a futex: the least that a blocking message can cost, and so the yardstick.

use super::mailbox::Mailboxes;
use crate::link::{Kind, Link, PLACES, Seat};
use hapfic_ipc::clock;
use rustix::io::Errno;
use rustix::thread::futex;
use std::io;
use std::os::fd::OwnedFd;
use std::time::Duration;

/// The kind of chain.
pub(super) struct Futex;

impl Kind for Futex {
    fn name(&self) -> &'static str {
        "futex"
    }

    fn prepare(&self, sizes: &[usize; PLACES]) -> io::Result<Vec<OwnedFd>> {
        Ok(vec![Mailboxes::make(sizes)?])
    }

    fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>> {
        let memory = seat.shared.first().ok_or_else(|| io::Error::other("the shared memory was not handed over"))?;
        let boxes = Mailboxes::open(memory, &seat)?;
        Ok(Box::new(Joined { boxes, to: seat.place, from: seat.before(), last: 0 }))
    }
}

struct Joined {
    boxes: Mailboxes,
    to: usize,
    from: usize,
    last: u32,
}

impl Link for Joined {
    fn send(&mut self, message: &[u8]) -> io::Result<()> {
        self.boxes.put(self.to, message)?;
        futex::wake(self.boxes.newest(self.to), futex::Flags::empty(), 1)?;
        Ok(())
    }

    fn receive(&mut self, into: &mut [u8], timeout: Option<Duration>) -> io::Result<usize> {
        let end = timeout.map(|timeout| clock::now_ns() + timeout.as_nanos() as u64);
        loop {
            if let Some(length) = self.boxes.take(self.from, &mut self.last, into)? {
                return Ok(length);
            }
            let left = match end.map(|end| end.saturating_sub(clock::now_ns())) {
                Some(0) => return Ok(0),
                left => left.map(clock::timespec),
            };
            match futex::wait(self.boxes.newest(self.from), futex::Flags::empty(), self.last, left.as_ref()) {
                // Changed before it could wait, woken for nothing, or the time is up: looks again.
                Ok(()) | Err(Errno::AGAIN | Errno::INTR | Errno::TIMEDOUT) => {}
                Err(e) => return Err(e.into()),
            }
        }
    }
}
