//! ZeroMQ's PUSH and PULL over Unix sockets, in its own library: each process has a thread of the library's for the sockets.

use crate::place;
use hapfic_diagnostics::{Kind, Link, Seat};
use std::io;
use std::time::Duration;
use zmq::{Context, Error, PULL, PUSH, Socket};

/// The kind of chain.
pub struct LibZmq;

impl Kind for LibZmq {
    fn name(&self) -> &'static str {
        "libzmq"
    }

    fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>> {
        let endpoint = |place| place::socket(&seat.chain, place).map(|path| format!("ipc://{}", path.display()));
        let context = Context::new();
        let pull = context.socket(PULL).map_err(failed)?;
        pull.bind(&endpoint(seat.place)?).map_err(failed)?;
        let push = context.socket(PUSH).map_err(failed)?;
        // What has not gone out when the chain ends is of no use.
        push.set_linger(0).map_err(failed)?;
        push.set_reconnect_ivl(10).map_err(failed)?;
        push.connect(&endpoint(seat.next())?).map_err(failed)?;
        Ok(Box::new(Joined { pull, push, timeout_ms: -1, _context: context }))
    }
}

fn failed(cause: Error) -> io::Error {
    io::Error::other(format!("ZeroMQ: {cause}"))
}

struct Joined {
    pull: Socket,
    push: Socket,
    /// As the socket has it; -1: for ever.
    timeout_ms: i32,
    _context: Context,
}

impl Link for Joined {
    fn send(&mut self, message: &[u8]) -> io::Result<()> {
        self.push.send(message, 0).map_err(failed)
    }

    fn receive(&mut self, into: &mut [u8], timeout: Option<Duration>) -> io::Result<usize> {
        // Whole milliseconds are all it knows.
        let timeout_ms = timeout.map_or(-1, |timeout| timeout.as_micros().div_ceil(1000) as i32);
        if timeout_ms != self.timeout_ms {
            self.pull.set_rcvtimeo(timeout_ms).map_err(failed)?;
            self.timeout_ms = timeout_ms;
        }
        loop {
            match self.pull.recv_into(into, 0) {
                Ok(length) if length > into.len() => return Err(io::Error::other("a message longer than all that are sent")),
                Ok(length) => return Ok(length),
                Err(Error::EAGAIN) => return Ok(0),
                Err(Error::EINTR) => {}
                Err(e) => return Err(failed(e)),
            }
        }
    }
}
