//! Messages as Unix datagrams: payload and wake-up in one, copied by the kernel.

use crate::link::{Kind, Link, STAGES, Seat};
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixDatagram;
use std::time::Duration;

/// Kind of chain over Unix datagram sockets.
pub(super) struct Datagram;

impl Kind for Datagram {
    fn name(&self) -> &'static str {
        "datagram"
    }

    /// Makes both sockets of each hop, the sending one first.
    fn prepare(&self, _sizes: &[usize; STAGES]) -> io::Result<Vec<OwnedFd>> {
        let mut shared = Vec::new();
        for _ in 0..STAGES {
            let (sender, receiver) = UnixDatagram::pair()?;
            shared.extend([sender.into(), receiver.into()]);
        }
        Ok(shared)
    }

    fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>> {
        let end = |hop: usize, receives: usize| -> io::Result<UnixDatagram> {
            let found = seat.shared.get(2 * hop + receives).ok_or_else(|| {
                io::Error::other(format!("found {} inherited sockets, expected {}", seat.shared.len(), 2 * STAGES))
            })?;
            Ok(found.try_clone()?.into())
        };
        Ok(Box::new(DatagramLink { to: end(seat.stage, 0)?, from: end(seat.before(), 1)?, timeout: None }))
    }
}

struct DatagramLink {
    to: UnixDatagram,
    from: UnixDatagram,
    /// Present timeout of the socket.
    timeout: Option<Duration>,
}

impl Link for DatagramLink {
    fn send(&mut self, message: &[u8]) -> io::Result<()> {
        self.to.send(message).map(drop)
    }

    fn receive(&mut self, into: &mut [u8], timeout: Option<Duration>) -> io::Result<usize> {
        // A socket timeout of zero means no limit.
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
