//! ZeroMQ's PUSH and PULL over Unix sockets, by libzmq, which serves the sockets on a thread of its own.

use crate::place;
use hapfic_diagnostics::{Kind, Link, Seat};
use std::io;
use std::time::Duration;
use zmq::{Context, Error, PULL, PUSH, Socket};

/// Chain over libzmq.
pub struct LibZmq;

impl Kind for LibZmq {
    fn name(&self) -> &'static str {
        "libzmq"
    }

    fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>> {
        let endpoint = |stage| place::socket(&seat.chain, stage).map(|path| format!("ipc://{}", path.display()));
        let context = Context::new();
        let pull = context.socket(PULL).map_err(to_io_error)?;
        pull.bind(&endpoint(seat.stage)?).map_err(to_io_error)?;
        let push = context.socket(PUSH).map_err(to_io_error)?;
        // Messages that are unsent when the chain ends are dropped.
        push.set_linger(0).map_err(to_io_error)?;
        push.set_reconnect_ivl(10).map_err(to_io_error)?;
        push.connect(&endpoint(seat.next())?).map_err(to_io_error)?;
        Ok(Box::new(LibZmqLink { pull, push, timeout_ms: -1, _context: context }))
    }
}

fn to_io_error(cause: Error) -> io::Error {
    io::Error::other(format!("ZeroMQ: {cause}"))
}

struct LibZmqLink {
    pull: Socket,
    push: Socket,
    /// Receive timeout of the socket [ms]; -1: none.
    timeout_ms: i32,
    _context: Context,
}

impl Link for LibZmqLink {
    fn send(&mut self, message: &[u8]) -> io::Result<()> {
        self.push.send(message, 0).map_err(to_io_error)
    }

    fn receive(&mut self, into: &mut [u8], timeout: Option<Duration>) -> io::Result<usize> {
        // libzmq takes whole milliseconds.
        let timeout_ms = timeout.map_or(-1, |timeout| timeout.as_micros().div_ceil(1000) as i32);
        if timeout_ms != self.timeout_ms {
            self.pull.set_rcvtimeo(timeout_ms).map_err(to_io_error)?;
            self.timeout_ms = timeout_ms;
        }
        loop {
            match self.pull.recv_into(into, 0) {
                Ok(length) if length > into.len() => {
                    return Err(io::Error::other("found a message longer than the longest of the chain"));
                }
                Ok(length) => return Ok(length),
                Err(Error::EAGAIN) => return Ok(0),
                Err(Error::EINTR) => {}
                Err(e) => return Err(to_io_error(e)),
            }
        }
    }
}
