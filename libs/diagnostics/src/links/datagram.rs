//! Messages as Unix datagrams: payload and wake-up in one, copied by the kernel.

use crate::link::{Kind, Link, PLACES, Seat};
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixDatagram;
use std::time::Duration;

/// The kind of chain.
pub(super) struct Datagram;

impl Kind for Datagram {
    fn name(&self) -> &'static str {
        "datagram"
    }

    /// Both ends of each hop: the one that sends first.
    fn prepare(&self, _sizes: &[usize; PLACES]) -> io::Result<Vec<OwnedFd>> {
        let mut shared = Vec::new();
        for _ in 0..PLACES {
            let (sends, receives) = UnixDatagram::pair()?;
            shared.extend([sends.into(), receives.into()]);
        }
        Ok(shared)
    }

    fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>> {
        let end = |hop: usize, receives: usize| -> io::Result<UnixDatagram> {
            let found = seat.shared.get(2 * hop + receives).ok_or_else(|| {
                io::Error::other(format!("found {} sockets handed over, expected {}", seat.shared.len(), 2 * PLACES))
            })?;
            Ok(found.try_clone()?.into())
        };
        Ok(Box::new(Joined { to: end(seat.place, 0)?, from: end(seat.before(), 1)?, timeout: None }))
    }
}

struct Joined {
    to: UnixDatagram,
    from: UnixDatagram,
    /// As the socket has it.
    timeout: Option<Duration>,
}

impl Link for Joined {
    fn send(&mut self, message: &[u8]) -> io::Result<()> {
        self.to.send(message).map(drop)
    }

    fn receive(&mut self, into: &mut [u8], timeout: Option<Duration>) -> io::Result<usize> {
        // A time of zero would mean for ever.
        let timeout = timeout.map(|timeout| timeout.max(Duration::from_micros(1)));
        if timeout != self.timeout {
            self.from.set_read_timeout(timeout)?;
            self.timeout = timeout;
        }
        loop {
            match self.from.recv(into) {
                Err(e) if matches!(e.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => return Ok(0),
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                other => return other,
            }
        }
    }
}
