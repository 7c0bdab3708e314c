//! ZeroMQ's PUSH and PULL over Unix sockets, by the implementation in Rust.
//!
//! The crate `zeromq` is asynchronous. Its tasks run on the thread that sends and receives: no message changes threads.

use crate::place;
use futures_util::StreamExt;
use hapfic_diagnostics::{Kind, Link, Seat};
use std::fmt::Display;
use std::io;
use std::time::{Duration, Instant};
use tokio::runtime::{Builder, Runtime};
use zeromq::{PullSocket, PushSocket, Socket, SocketEvent, SocketRecv, SocketSend, ZmqMessage};

/// Timeout for the other stages to connect.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);
/// Interval of attempts to connect.
const RETRY_INTERVAL: Duration = Duration::from_millis(10);

/// Chain over the crate `zeromq`.
pub struct ZeroMq;

impl Kind for ZeroMq {
    fn name(&self) -> &'static str {
        "zeromq"
    }

    fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>> {
        let endpoint = |stage| place::socket(&seat.chain, stage).map(|path| format!("ipc://{}", path.display()));
        let (own, next) = (endpoint(seat.stage)?, endpoint(seat.next())?);
        let runtime = Builder::new_current_thread().enable_all().build()?;
        let (pull, push) = runtime.block_on(async {
            let mut pull = PullSocket::new();
            let mut events = pull.monitor();
            pull.bind(&own).await.map_err(to_io_error)?;
            let mut push = PushSocket::new();
            let start = Instant::now();
            while let Err(cause) = push.connect(&next).await {
                if start.elapsed() > CONNECT_TIMEOUT {
                    return Err(to_io_error(cause));
                }
                tokio::time::sleep(RETRY_INTERVAL).await;
            }
            // The tasks run only while this thread waits here: wait until the previous stage is accepted.
            let accepted = async {
                while let Some(event) = events.next().await {
                    if matches!(event, SocketEvent::Accepted(..)) {
                        return true;
                    }
                }
                false
            };
            match tokio::time::timeout(CONNECT_TIMEOUT, accepted).await {
                Ok(true) => Ok((pull, push)),
                _ => Err(to_io_error(format!(
                    "the previous stage has not connected, expected a connection within {} s",
                    CONNECT_TIMEOUT.as_secs()
                ))),
            }
        })?;
        Ok(Box::new(ZeroMqLink { pull, push, runtime }))
    }
}

fn to_io_error(cause: impl Display) -> io::Error {
    io::Error::other(format!("ZeroMQ: {cause}"))
}

struct ZeroMqLink {
    pull: PullSocket,
    push: PushSocket,
    runtime: Runtime,
}

impl Link for ZeroMqLink {
    fn send(&mut self, message: &[u8]) -> io::Result<()> {
        self.runtime.block_on(self.push.send(ZmqMessage::from(message.to_vec()))).map_err(to_io_error)
    }

    fn receive(&mut self, into: &mut [u8], timeout: Option<Duration>) -> io::Result<usize> {
        let Self { pull, runtime, .. } = self;
        let received = runtime.block_on(async {
            match timeout {
                Some(timeout) => tokio::time::timeout(timeout, pull.recv()).await.ok(),
                None => Some(pull.recv().await),
            }
        });
        let Some(message) = received else { return Ok(0) };
        let message = message.map_err(to_io_error)?;
        let bytes = message.get(0).ok_or_else(|| to_io_error("found a message without a frame"))?;
        let buffer =
            into.get_mut(..bytes.len()).ok_or_else(|| to_io_error("found a message longer than the longest of the chain"))?;
        buffer.copy_from_slice(bytes);
        Ok(bytes.len())
    }
}
