//! Messages in shared memory, woken by a futex: the lowest cost of a blocking message, and so the baseline.

use super::mailbox::Mailboxes;
use crate::link::{Kind, Link, STAGES, Seat};
use hapfic_ipc::clock;
use rustix::io::Errno;
use rustix::thread::futex;
use std::io;
use std::os::fd::OwnedFd;
use std::time::Duration;

/// Kind of chain over shared memory and futexes.
pub(super) struct Futex;

impl Kind for Futex {
    fn name(&self) -> &'static str {
        "futex"
    }

    fn prepare(&self, sizes: &[usize; STAGES]) -> io::Result<Vec<OwnedFd>> {
        Ok(vec![Mailboxes::make(sizes)?])
    }

    fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>> {
        let memory =
            seat.shared.first().ok_or_else(|| io::Error::other("found no inherited shared memory, expected one file"))?;
        let mailboxes = Mailboxes::open(memory, &seat)?;
        Ok(Box::new(FutexLink { mailboxes, to: seat.stage, from: seat.before(), last: 0 }))
    }
}

struct FutexLink {
    mailboxes: Mailboxes,
    to: usize,
    from: usize,
    last: u32,
}

impl Link for FutexLink {
    fn send(&mut self, message: &[u8]) -> io::Result<()> {
        self.mailboxes.put(self.to, message)?;
        futex::wake(self.mailboxes.newest(self.to), futex::Flags::empty(), 1)?;
        Ok(())
    }

    fn receive(&mut self, into: &mut [u8], timeout: Option<Duration>) -> io::Result<usize> {
        let end = timeout.map(|timeout| clock::now_ns() + timeout.as_nanos() as u64);
        loop {
            if let Some(length) = self.mailboxes.take(self.from, &mut self.last, into)? {
                return Ok(length);
            }
            let left = match end.map(|end| end.saturating_sub(clock::now_ns())) {
                Some(0) => return Ok(0),
                left => left.map(clock::timespec),
            };
            match futex::wait(self.mailboxes.newest(self.from), futex::Flags::empty(), self.last, left.as_ref()) {
                // Changed before the wait, interrupted, spurious or timed out: checks again.
                Ok(()) | Err(Errno::AGAIN | Errno::INTR | Errno::TIMEDOUT) => {}
                Err(e) => return Err(e.into()),
            }
        }
    }
}
