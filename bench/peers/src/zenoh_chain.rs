//! zenoh between three peers that know each other's Unix sockets: no scouting, highest priority, no batching.
//!
//! With shared memory each message is put into a buffer of zenoh's shared-memory provider, and a note of it goes through the socket;
//! without, the message itself does.

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

/// Name of the kind with shared memory.
pub const WITH_MEMORY: &str = "zenoh-shm";
/// Messages that the provider has room for.
const ROOM: usize = 64;

/// The kind of chain.
pub struct Zenoh {
    /// Whether messages go through shared memory.
    pub shared_memory: bool,
}

impl Kind for Zenoh {
    fn name(&self) -> &'static str {
        if self.shared_memory { WITH_MEMORY } else { "zenoh" }
    }

    fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>> {
        let own = place::socket(&seat.chain, seat.place)?;
        let next = place::socket(&seat.chain, seat.next())?;
        // The relays come up one after the other: so it is tried again at once.
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
        let session = zenoh::open(Config::from_json5(&config).map_err(failed)?).wait().map_err(failed)?;
        let publisher = session
            .declare_publisher(seat.name_of(seat.place))
            .congestion_control(CongestionControl::Block)
            .priority(Priority::RealTime)
            .express(true)
            .wait()
            .map_err(failed)?;
        let subscriber = session.declare_subscriber(seat.name_of(seat.before())).wait().map_err(failed)?;
        let memory = if self.shared_memory {
            let bytes = ROOM * seat.longest().next_power_of_two();
            Some(ShmProviderBuilder::default_backend(bytes).wait().map_err(failed)?)
        } else {
            None
        };
        Ok(Box::new(Joined { publisher, subscriber, memory, _session: session }))
    }
}

fn failed(cause: impl Display) -> io::Error {
    io::Error::other(format!("zenoh: {cause}"))
}

struct Joined {
    publisher: Publisher<'static>,
    subscriber: Subscriber<FifoChannelHandler<Sample>>,
    memory: Option<ShmProvider<PosixShmProviderBackend>>,
    _session: Session,
}

impl Link for Joined {
    fn send(&mut self, message: &[u8]) -> io::Result<()> {
        match &self.memory {
            Some(memory) => {
                let wanted = memory.alloc(message.len()).with_policy::<BlockOn<GarbageCollect>>();
                let mut buffer = wanted.wait().map_err(failed)?;
                buffer.copy_from_slice(message);
                self.publisher.put(buffer).wait().map_err(failed)
            }
            None => self.publisher.put(message).wait().map_err(failed),
        }
    }

    fn receive(&mut self, into: &mut [u8], timeout: Option<Duration>) -> io::Result<usize> {
        let received = match timeout {
            Some(timeout) => self.subscriber.recv_timeout(timeout).map_err(failed)?,
            None => Some(self.subscriber.recv().map_err(failed)?),
        };
        let Some(sample) = received else { return Ok(0) };
        if self.memory.is_some() && sample.payload().as_shm().is_none() {
            return Err(failed("a message has come through the socket, expected all of them in shared memory"));
        }
        let bytes = sample.payload().to_bytes();
        let place = into.get_mut(..bytes.len()).ok_or_else(|| failed("a message longer than all that are sent"))?;
        place.copy_from_slice(&bytes);
        Ok(bytes.len())
    }
}
