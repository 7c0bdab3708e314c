//! ZeroMQ's PUSH and PULL over Unix sockets, in its implementation in Rust.
//!
//! The crate `zeromq` is asynchronous; its tasks run on the one thread that sends and receives, so that no message changes threads.

use crate::place;
use futures_util::StreamExt;
use hapfic_diagnostics::{Kind, Link, Seat};
use std::fmt::Display;
use std::io;
use std::time::{Duration, Instant};
use tokio::runtime::{Builder, Runtime};
use zeromq::{PullSocket, PushSocket, Socket, SocketEvent, SocketRecv, SocketSend, ZmqMessage};

/// How long the others may take to join.
const TIMEOUT: Duration = Duration::from_secs(10);
/// How long until the next one is looked for again.
const AGAIN: Duration = Duration::from_millis(10);

/// The kind of chain.
pub struct ZeroMq;

impl Kind for ZeroMq {
    fn name(&self) -> &'static str {
        "zeromq"
    }

    fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>> {
        let endpoint = |place| place::socket(&seat.chain, place).map(|path| format!("ipc://{}", path.display()));
        let (own, next) = (endpoint(seat.place)?, endpoint(seat.next())?);
        let runtime = Builder::new_current_thread().enable_all().build()?;
        let (pull, push) = runtime.block_on(async {
            let mut pull = PullSocket::new();
            let mut events = pull.monitor();
            pull.bind(&own).await.map_err(failed)?;
            let mut push = PushSocket::new();
            let begun = Instant::now();
            while let Err(cause) = push.connect(&next).await {
                if begun.elapsed() > TIMEOUT {
                    return Err(failed(cause));
                }
                tokio::time::sleep(AGAIN).await;
            }
            // Its tasks run only while this thread waits in here: stay until the one before has been let in.
            let let_in = async {
                while let Some(event) = events.next().await {
                    if matches!(event, SocketEvent::Accepted(..)) {
                        return true;
                    }
                }
                false
            };
            match tokio::time::timeout(TIMEOUT, let_in).await {
                Ok(true) => Ok((pull, push)),
                _ => Err(failed("the place before has not connected")),
            }
        })?;
        Ok(Box::new(Joined { pull, push, runtime }))
    }
}

fn failed(cause: impl Display) -> io::Error {
    io::Error::other(format!("ZeroMQ: {cause}"))
}

struct Joined {
    pull: PullSocket,
    push: PushSocket,
    runtime: Runtime,
}

impl Link for Joined {
    fn send(&mut self, message: &[u8]) -> io::Result<()> {
        self.runtime.block_on(self.push.send(ZmqMessage::from(message.to_vec()))).map_err(failed)
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
        let message = message.map_err(failed)?;
        let bytes = message.get(0).ok_or_else(|| failed("a message without a frame"))?;
        let place = into.get_mut(..bytes.len()).ok_or_else(|| failed("a message longer than all that are sent"))?;
        place.copy_from_slice(bytes);
        Ok(bytes.len())
    }
}
