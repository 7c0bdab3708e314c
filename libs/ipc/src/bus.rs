//! Ports over iceoryx2.
//!
//! Each topic is a publish-subscribe service and, where someone waits for it, a doorbell ([`crate::doorbell`]). Sending makes no system call
//! but the ring and no heap allocation: the sample is loaned beforehand, in the slack ([`Output::prepare`]).

use crate::clock;
use crate::doorbell::{Doorbell, DoorbellId, DoorbellPage, Listener, Wakes};
use crate::error::IpcError;
use crate::memory::{self, Senders};
use crate::topic::{RECORDER_DEPTH, Topic};
use crate::wire::Wire;
use core::mem::MaybeUninit;
use core::time::Duration;
use hapfic_messages::{CONTROL_DEPTH, Clock, Message};
use iceoryx2::config::Config;
use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::port::ReceiveError;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use std::sync::Arc;

type Service = ipc::Service;

/// Most that may take part in a topic at a time.
const MAX_NODES: usize = 32;
const MAX_SUBSCRIBERS: usize = 12;

/// A run's own corner of the machine: nothing in it is seen by another run.
#[derive(Clone, Debug)]
pub struct Domain {
    config: Config,
    folder: String,
}

impl Domain {
    /// `prefix` starts the name of every shared memory segment (short, unique, letters, digits and `_`); `root` is a folder of
    /// the run's own on tmpfs. Keep it short: a Unix socket's path has 108 bytes.
    ///
    /// # Errors
    /// [`IpcError::Name`] if iceoryx2 cannot use one of them.
    pub fn new(prefix: &str, root: &str) -> Result<Self, IpcError> {
        let mut config = Config::default();
        config.global.prefix = FileName::new(prefix.as_bytes()).map_err(|e| IpcError::Name {
            what: "a prefix",
            value: prefix.to_owned(),
            cause: format!("{e:?}"),
        })?;
        let path = Path::new(root.as_bytes()).map_err(|e| IpcError::Name {
            what: "a folder",
            value: root.to_owned(),
            cause: format!("{e:?}"),
        })?;
        config.global.set_root_path(&path);
        // Sweeping after a dead process costs milliseconds: the supervisor does it, when it knows of a death.
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        Ok(Self { config, folder: root.to_owned() })
    }

    /// The same corner for those who live on while others die: they wait only so long for a connection that another has begun to make.
    /// One who was killed in the middle never finishes it, and iceoryx2 would wait for him for a second, in the middle of a tick.
    /// What could not be met counts as [failed_connections](Output::failed_connections) and is tried again when somebody joins or leaves.
    #[must_use]
    pub fn with_short_timeouts(&self, clock: Clock) -> Self {
        let mut config = self.config.clone();
        config.global.creation_timeout = match clock {
            Clock::Realtime => Duration::from_millis(5),
            Clock::Lockstep => Duration::from_millis(200),
        };
        Self { config, folder: self.folder.clone() }
    }
}

/// Whether an input can be waited for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wait {
    /// It takes part in [`wait`](crate::wait).
    Yes,
    /// It is only looked at.
    No,
}

/// A process's, or a thread's, access to the topics. Not shared between threads: each opens its own.
#[derive(Debug)]
pub struct Bus {
    pub(crate) node: Node<Service>,
    page: Arc<DoorbellPage>,
}

impl Bus {
    /// Joins the run's domain under a name.
    ///
    /// # Errors
    /// [`IpcError`] if the name is no good or shared memory cannot be had.
    pub fn open(domain: &Domain, name: &str) -> Result<Self, IpcError> {
        let node_name = name.try_into().map_err(|e| IpcError::Name {
            what: "a node's name",
            value: name.to_owned(),
            cause: format!("{e:?}"),
        })?;
        let node = NodeBuilder::new()
            .config(&domain.config)
            .name(&node_name)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Service>()
            .map_err(|e| IpcError::messaging("create node", name, e))?;
        Ok(Self { node, page: DoorbellPage::open(&domain.folder)? })
    }

    /// Removes what killed processes have left in the domain: milliseconds, and not for real-time threads.
    pub fn clean_up_dead_nodes(&self) {
        // What cannot be removed now is removed with the whole domain at the end of the run.
        let _ = self.node.try_cleanup_dead_nodes();
    }

    fn service<T: Message>(
        &self,
        topic: &Topic<T>,
    ) -> Result<iceoryx2::service::port_factory::publish_subscribe::PortFactory<Service, Wire<T>, ()>, IpcError> {
        self.node
            .service_builder(&service_name(topic.name)?)
            .publish_subscribe::<Wire<T>>()
            .max_publishers(topic.publishers)
            .max_subscribers(MAX_SUBSCRIBERS)
            .max_nodes(MAX_NODES)
            .subscriber_max_buffer_size(RECORDER_DEPTH)
            .subscriber_max_borrowed_samples(2)
            .history_size(topic.history)
            .enable_safe_overflow(true)
            .open_or_create()
            .map_err(|e| IpcError::messaging("open topic", topic.name, e))
    }

    /// Creates a topic and keeps it in being as long as the returned guard lives. Who creates first must outlive the others:
    /// a process killed while it creates a service can leave it unusable.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] with what iceoryx2 said.
    pub fn keep_alive<T: Message>(&self, topic: &Topic<T>) -> Result<Box<dyn core::any::Any>, IpcError> {
        Ok(Box::new(self.service(topic)?))
    }

    /// A sender.
    ///
    /// # Errors
    /// [`IpcError::Messaging`], also when the topic has all the publishers it takes.
    pub fn output<T: Message>(&self, topic: &Topic<T>) -> Result<Output<T>, IpcError> {
        let output = self.bare_output(topic)?;
        if let Some(first) = &output.loan {
            memory::prefault_writes(first.payload().as_ptr());
        }
        Ok(output)
    }

    fn bare_output<T: Message>(&self, topic: &Topic<T>) -> Result<Output<T>, IpcError> {
        let publisher = self
            .service(topic)?
            .publisher_builder()
            .max_loaned_samples(2)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| IpcError::messaging("publish on", topic.name, e))?;
        let doorbell = topic.doorbell.map(|place| self.doorbell(place));
        let mut output = Output { publisher, doorbell, loan: None, topic: topic.name, failed_connections: 0 };
        output.preloan();
        Ok(output)
    }

    fn input_of<T: Message>(&self, topic: &Topic<T>, wait: Wait, depth: usize) -> Result<Input<T>, IpcError> {
        let listener = if wait == Wait::Yes { topic.doorbell.map(|place| self.listener(place)) } else { None };
        let subscriber = self
            .service(topic)?
            .subscriber_builder()
            .buffer_size(depth)
            .history_request(topic.history)
            .create()
            .map_err(|e| IpcError::messaging("subscribe to", topic.name, e))?;
        Ok(Input { subscriber, listener, topic: topic.name, failed_connections: 0, senders: Senders::default() })
    }

    /// A receiver for control: a short buffer of which the newest counts.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] with what iceoryx2 said.
    pub fn input<T: Message>(&self, topic: &Topic<T>, wait: Wait) -> Result<Input<T>, IpcError> {
        self.input_of(topic, wait, CONTROL_DEPTH)
    }

    /// Joins a topic and leaves it again: so that all that are in it look round once more for those they could not meet.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] with what iceoryx2 said.
    pub fn force_reconnect<T: Message>(&self, topic: &Topic<T>) -> Result<(), IpcError> {
        drop(self.input(topic, Wait::No)?);
        drop(self.bare_output(topic)?);
        Ok(())
    }

    /// Wakes those who wait for a topic without sending anything: they look around and find what has changed.
    #[must_use]
    pub fn doorbell(&self, place: DoorbellId) -> Doorbell {
        Doorbell::new(&self.page, place)
    }

    /// Hears a doorbell with which no message comes.
    #[must_use]
    pub fn listener(&self, place: DoorbellId) -> Listener {
        Listener::new(&self.page, place)
    }

    /// A receiver for the recorder: a deep buffer that must not overflow.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] with what iceoryx2 said.
    pub fn recorder_input<T: Message>(&self, topic: &Topic<T>) -> Result<Input<T>, IpcError> {
        self.input_of(topic, Wait::No, RECORDER_DEPTH)
    }
}

pub(crate) fn service_name(name: &str) -> Result<ServiceName, IpcError> {
    name.try_into().map_err(|e| IpcError::Name { what: "a topic's name", value: name.to_owned(), cause: format!("{e:?}") })
}

/// A sender of one topic.
pub struct Output<T: Message> {
    publisher: Publisher<Service, Wire<T>, ()>,
    doorbell: Option<Doorbell>,
    loan: Option<SampleMutUninit<Service, MaybeUninit<Wire<T>>, ()>>,
    topic: &'static str,
    failed_connections: u32,
}

// SAFETY: what keeps a port of `ipc::Service` on one thread is a reference count that is not atomic (iceoryx2 0.10, to which this
// workspace is pinned: `arc_sync_policy::SingleThreaded`, an `Rc` of a state that may itself be sent; nodes and services are counted by
// `Arc`; no handler of ours is in it). All that count are the publisher and the loan in here, so they go from thread to thread together.
unsafe impl<T: Message> Send for Output<T> {}

impl<T: Message> core::fmt::Debug for Output<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Output").field("topic", &self.topic).field("loan", &self.loan.is_some()).finish()
    }
}

impl<T: Message> Output<T> {
    /// Work for the slack: loans the sample that the next [`send`](Self::send) will fill (one heap allocation), and lets those
    /// in who have joined since (history is handed over here).
    pub fn preloan(&mut self) {
        self.update_connections();
        // A failure shows at the next send, which then has no loan.
        if self.loan.is_none() {
            self.loan = self.publisher.loan_uninit().ok();
        }
    }

    /// Writes a message where the next one will be written, and sends nothing: so that it is in the caches then. Work for the slack, as
    /// [`prepare`](Self::prepare): it allocates.
    pub fn warm_up(&mut self, message: &T) {
        self.preloan();
        if let Some(loan) = &mut self.loan {
            loan.payload_mut().write(Wire(*message));
        }
        // Another loan looks for what the receivers have given back, as sending will.
        drop(self.publisher.loan_uninit());
    }

    fn update_connections(&mut self) {
        self.failed_connections += u32::from(self.publisher.update_connections().is_err());
    }

    /// How often somebody who had joined could not be met.
    #[must_use]
    pub fn failed_connections(&self) -> u32 {
        self.failed_connections
    }

    /// Sends a message and wakes whoever waits for it. Returns when it was there to be read, by the monotonic clock: before the
    /// waking, since whoever wakes may take the processor at once.
    ///
    /// # Errors
    /// [`IpcError::NoLoan`] if all memory is lent out; [`IpcError::Messaging`] if iceoryx2 fails.
    pub fn send(&mut self, message: &T) -> Result<u64, IpcError> {
        let loan = match self.loan.take() {
            Some(loan) => loan,
            None => self.publisher.loan_uninit().map_err(|_| IpcError::NoLoan { topic: self.topic })?,
        };
        // A joiner that died half-way cannot be met: that must not cost this message, and is over once it has been tried.
        self.update_connections();
        loan.write_payload(Wire(*message)).send().map_err(|e| IpcError::messaging("send on", self.topic, e))?;
        let published = clock::now_ns();
        if let Some(doorbell) = &self.doorbell {
            doorbell.notify();
        }
        Ok(published)
    }
}

/// A receiver of one topic.
#[derive(Debug)]
pub struct Input<T: Message> {
    subscriber: Subscriber<Service, Wire<T>, ()>,
    listener: Option<Listener>,
    topic: &'static str,
    failed_connections: u32,
    senders: Senders,
}

// SAFETY: as with outputs; samples do not outlive the call that takes them.
unsafe impl<T: Message> Send for Input<T> {}

impl<T: Message> Input<T> {
    /// The oldest message not taken yet, copied out of shared memory so that no sender can change it afterwards.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] if a connection is damaged.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> Result<Option<T>, IpcError> {
        let received = match self.subscriber.receive() {
            // As in sending: one that cannot be met costs nobody else's messages.
            Err(ReceiveError::ConnectionFailure(_)) => {
                self.failed_connections += 1;
                self.subscriber.receive()
            }
            received => received,
        };
        match received {
            Ok(None) => Ok(None),
            Ok(Some(sample)) => {
                self.senders.look_at(sample.payload(), sample.origin());
                Ok(Some(sample.0))
            }
            Err(e) => Err(IpcError::messaging("receive on", self.topic, e)),
        }
    }

    /// Work for the slack: meets those who have joined since, so that the next [`next`](Self::next) need not, and brings in the memory
    /// through which the messages of those who have begun to send will come.
    pub fn preloan(&mut self) {
        self.senders.prefault::<T>();
        self.failed_connections += u32::from(self.subscriber.update_connections().is_err());
    }

    /// Has the next wait not end by what was sent before now.
    pub fn forget(&self) {
        if let Some(listener) = &self.listener {
            listener.forget();
        }
    }

    /// How often somebody who had joined could not be met.
    #[must_use]
    pub fn failed_connections(&self) -> u32 {
        self.failed_connections
    }

    /// The newest message, if any came since the last call.
    ///
    /// # Errors
    /// As [`next`](Self::next).
    pub fn newest(&mut self) -> Result<Option<T>, IpcError> {
        let mut newest = None;
        while let Some(message) = self.next()? {
            newest = Some(message);
        }
        Ok(newest)
    }
}

impl<T: Message> Wakes for Input<T> {
    fn listener(&self) -> Option<&Listener> {
        self.listener.as_ref()
    }
}
