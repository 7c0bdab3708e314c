//! zenoh between three peers that know each other's Unix sockets: no scouting, highest priority, no batching.
//!
//! With shared memory each message is in a buffer of zenoh's shared-memory provider, and a notice goes through the
//! socket. Without shared memory the message itself goes through the socket.

use crate::place;
use hapfic_diagnostics::{Kind, Link, Seat};
use std::fmt::Display;
use std::io;
use std::time::Duration;
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::{CongestionControl, Priority};
use zenoh::sample::Sample;
use zenoh::shm::{BlockOn, GarbageCollect, PosixShmProviderBackend, ShmProvider, ShmProviderBuilder};
use zenoh::{Config, Session, Wait};

/// Name of the chain with shared memory.
pub const WITH_MEMORY: &str = "zenoh-shm";
/// Capacity of the provider [messages].
const CAPACITY: usize = 64;

/// Chain over zenoh.
pub struct Zenoh {
    /// Whether messages go through shared memory.
    pub shared_memory: bool,
}

impl Kind for Zenoh {
    fn name(&self) -> &'static str {
        if self.shared_memory { WITH_MEMORY } else { "zenoh" }
    }

    fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>> {
        let own = place::socket(&seat.chain, seat.stage)?;
        let next = place::socket(&seat.chain, seat.next())?;
        // The relays start one after the other: short retry periods connect them soon.
        let config = format!(
            r#"{{
                mode: "peer",
                listen: {{ endpoints: ["unixsock-stream/{}"] }},
                connect: {{
                    endpoints: ["unixsock-stream/{}"],
                    timeout_ms: -1,
                    exit_on_failure: false,
                    retry: {{ period_init_ms: 20, period_max_ms: 20, period_increase_factor: 1 }},
                }},
                scouting: {{ multicast: {{ enabled: false }}, gossip: {{ enabled: false }} }},
                transport: {{ shared_memory: {{ enabled: {}, mode: "init" }} }},
            }}"#,
            own.display(),
            next.display(),
            self.shared_memory
        );
        let session = zenoh::open(Config::from_json5(&config).map_err(to_io_error)?).wait().map_err(to_io_error)?;
        let publisher = session
            .declare_publisher(seat.name_of(seat.stage))
            .congestion_control(CongestionControl::Block)
            .priority(Priority::RealTime)
            .express(true)
            .wait()
            .map_err(to_io_error)?;
        let subscriber = session.declare_subscriber(seat.name_of(seat.before())).wait().map_err(to_io_error)?;
        let memory = if self.shared_memory {
            let bytes = CAPACITY * seat.longest().next_power_of_two();
            Some(ShmProviderBuilder::default_backend(bytes).wait().map_err(to_io_error)?)
        } else {
            None
        };
        Ok(Box::new(ZenohLink { publisher, subscriber, memory, _session: session }))
    }
}

fn to_io_error(cause: impl Display) -> io::Error {
    io::Error::other(format!("zenoh: {cause}"))
}

struct ZenohLink {
    publisher: Publisher<'static>,
    subscriber: Subscriber<FifoChannelHandler<Sample>>,
    memory: Option<ShmProvider<PosixShmProviderBackend>>,
    _session: Session,
}

impl Link for ZenohLink {
    fn send(&mut self, message: &[u8]) -> io::Result<()> {
        match &self.memory {
            Some(memory) => {
                let allocation = memory.alloc(message.len()).with_policy::<BlockOn<GarbageCollect>>();
                let mut buffer = allocation.wait().map_err(to_io_error)?;
                buffer.copy_from_slice(message);
                self.publisher.put(buffer).wait().map_err(to_io_error)
            }
            None => self.publisher.put(message).wait().map_err(to_io_error),
        }
    }

    fn receive(&mut self, into: &mut [u8], timeout: Option<Duration>) -> io::Result<usize> {
        let received = match timeout {
            Some(timeout) => self.subscriber.recv_timeout(timeout).map_err(to_io_error)?,
            None => Some(self.subscriber.recv().map_err(to_io_error)?),
        };
        let Some(sample) = received else { return Ok(0) };
        if self.memory.is_some() && sample.payload().as_shm().is_none() {
            return Err(to_io_error("found a message in the socket, expected all messages in shared memory"));
        }
        let bytes = sample.payload().to_bytes();
        let buffer =
            into.get_mut(..bytes.len()).ok_or_else(|| to_io_error("found a message longer than the longest of the chain"))?;
        buffer.copy_from_slice(&bytes);
        Ok(bytes.len())
    }
}
