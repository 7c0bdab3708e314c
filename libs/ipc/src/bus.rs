//! Topics over iceoryx2: the namespace of a run, and access to its topics.
//!
//! Each topic is a publish-subscribe service and, where a thread waits for it, a doorbell ([`crate::doorbell`]).
//! Sending makes no heap allocation, since a port loans the sample beforehand, in idle time ([`Output::preloan`]). Its
//! only system call is the doorbell's.

use crate::doorbell::{Doorbell, DoorbellId, DoorbellPage, Listener};
use crate::error::IpcError;
use crate::heartbeat::HeartbeatPage;
use crate::memory::{self, Senders};
use crate::message_ring::{KeptMessages, MessageRing};
use crate::plant_memory::PlantMemory;
use crate::ports::{Input, Output, on_degradation};
use crate::topic::Topic;
use crate::wire::Wire;
use core::time::Duration;
use hapfic_messages::{CONTROL_DEPTH, Clock, Message, Process};
use iceoryx2::config::Config;
use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::prelude::*;
use std::sync::Arc;

type Service = ipc::Service;

/// Most nodes on a topic at a time.
const MAX_NODES: usize = 32;

/// Namespace of a run: no other run on the machine sees anything in it.
#[derive(Clone, Debug)]
pub struct Domain {
    config: Config,
    folder: String,
}

impl Domain {
    /// Creates the namespace. `prefix` starts the name of every shared memory segment (short, unique, letters, digits
    /// and `_`). `root` is the run's own folder on tmpfs. Keep it short: a Unix socket's path has 108 bytes.
    ///
    /// # Errors
    /// [`IpcError::Name`] if iceoryx2 cannot use `prefix` or `root`.
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
        // Clean-up after a dead process takes milliseconds: the supervisor does it, when it knows of a death.
        config.global.node.cleanup_dead_nodes_on_creation = false;
        config.global.node.cleanup_dead_nodes_on_destruction = false;
        config.global.service.cleanup_dead_nodes_on_open = false;
        Ok(Self { config, folder: root.to_owned() })
    }

    /// The same namespace with short time-outs, for processes that keep running while others die.
    ///
    /// A process that is killed while it connects never completes the connection. By default iceoryx2 would wait a
    /// second for it, in the middle of a tick. Such a connection counts as [failed](crate::failed_connections); every
    /// join or leave of a process retries it.
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

/// Whether a thread can wait for an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wait {
    /// It takes part in [`wait`](crate::wait).
    Yes,
    /// It is only polled.
    No,
}

/// Access of a process, or of a thread, to the topics. Threads do not share it: each opens its own.
#[derive(Debug)]
pub struct Bus {
    pub(crate) node: Node<Service>,
    page: Arc<DoorbellPage>,
    heartbeats: Arc<HeartbeatPage>,
    folder: String,
}

impl Bus {
    /// Joins the run's domain under a node name.
    ///
    /// # Errors
    /// [`IpcError`] if the name is invalid or shared memory is not available.
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
        let heartbeats = Arc::new(HeartbeatPage::open(&domain.folder)?);
        Ok(Self { node, page: DoorbellPage::open(&domain.folder)?, heartbeats, folder: domain.folder.clone() })
    }

    /// Heartbeats of all processes of the run.
    #[must_use]
    pub fn heartbeats(&self) -> Arc<HeartbeatPage> {
        Arc::clone(&self.heartbeats)
    }

    /// What the run's plants remember.
    ///
    /// # Errors
    /// [`IpcError::System`] if it cannot be mapped.
    pub fn plant_memory(&self) -> Result<PlantMemory, IpcError> {
        PlantMemory::open(&self.folder)
    }

    /// Removes the remains of killed processes from the domain. Takes milliseconds: not for real-time threads.
    pub fn clean_up_dead_nodes(&self) {
        // The rest is removed with the whole domain at the end of the run.
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
            .max_subscribers(topic.subscribers)
            .max_nodes(MAX_NODES)
            .subscriber_max_buffer_size(topic.depth)
            .subscriber_max_borrowed_samples(2)
            .history_size(topic.history)
            .enable_safe_overflow(true)
            .open_or_create()
            .map_err(|e| IpcError::messaging("open topic", topic.name, e))
    }

    /// Creates a topic and keeps it alive until the returned guard drops.
    ///
    /// The process that creates topics must outlive the others: a process killed while it creates a service can leave
    /// it unusable.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] with the cause from iceoryx2.
    pub fn keep_alive<T: Message>(&self, topic: &Topic<T>) -> Result<Box<dyn core::any::Any>, IpcError> {
        Ok(Box::new(self.service(topic)?))
    }

    /// Keeps all services of a run alive, until what is returned is dropped.
    ///
    /// The supervisor does: a service that loses its last process is removed.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] with the cause from iceoryx2.
    pub fn keep_all_alive(&self) -> Result<Vec<Box<dyn core::any::Any>>, IpcError> {
        use crate::topic;
        Ok(vec![
            self.keep_alive(&topic::STATE)?,
            self.keep_alive(&topic::REFERENCE)?,
            self.keep_alive(&topic::REQUEST)?,
            self.keep_alive(&topic::COMMAND)?,
            self.keep_alive(&topic::OPERATOR)?,
            self.keep_alive(&topic::EVENT)?,
            self.keep_alive(&topic::TIMING)?,
            self.keep_alive(&topic::CREDIT)?,
            self.keep_alive(&topic::INJECTION)?,
            self.keep_alive(&topic::view::STATE)?,
            self.keep_alive(&topic::view::REFERENCE)?,
            self.keep_alive(&topic::view::REQUEST)?,
            self.keep_alive(&topic::view::COMMAND)?,
            self.keep_alive(&topic::view::OPERATOR)?,
            self.keep_alive(&topic::view::EVENT)?,
            self.keep_alive(&topic::view::TIMING)?,
            crate::service::keep_alive(self)?,
        ])
    }

    /// Opens a sender.
    ///
    /// # Errors
    /// [`IpcError::Messaging`], also when the topic has its full number of publishers.
    pub fn output<T: Message>(&self, topic: &Topic<T>) -> Result<Output<T>, IpcError> {
        let output = self.bare_output(topic)?;
        if let Some(first) = &output.loan {
            memory::prefault_writes(first.payload().as_ptr());
        }
        Ok(output)
    }

    /// Opens a sender whose last messages outlive it, as far as the topic keeps them with this clock.
    ///
    /// # Errors
    /// As [`output`](Self::output), and [`IpcError::System`] if the messages cannot be kept.
    pub fn kept_output<T: Message>(&self, topic: &Topic<T>, sender: Process, clock: Clock) -> Result<Output<T>, IpcError> {
        let ring = MessageRing::open(&self.folder, topic, sender, clock)?;
        if let Some(ring) = &ring {
            ring.prefault_writes();
        }
        Ok(Output { ring, ..self.output(topic)? })
    }

    /// Last messages of a sender, living or dead, the oldest first; none if the topic keeps none with this clock.
    ///
    /// # Errors
    /// [`IpcError::System`] if they cannot be read.
    pub fn kept<T: Message>(&self, topic: &Topic<T>, sender: Process, clock: Clock) -> Result<Vec<T>, IpcError> {
        Ok(MessageRing::open(&self.folder, topic, sender, clock)?.map_or_else(Vec::new, |ring| ring.read()))
    }

    /// Opens the last messages of a sender; `None` if the topic keeps none with this clock.
    ///
    /// # Errors
    /// [`IpcError::System`] if they cannot be mapped.
    pub fn kept_messages<T: Message>(
        &self,
        topic: &Topic<T>,
        sender: Process,
        clock: Clock,
    ) -> Result<Option<KeptMessages<T>>, IpcError> {
        Ok(MessageRing::open(&self.folder, topic, sender, clock)?.map(KeptMessages::new))
    }

    fn bare_output<T: Message>(&self, topic: &Topic<T>) -> Result<Output<T>, IpcError> {
        let publisher = self
            .service(topic)?
            .publisher_builder()
            .max_loaned_samples(2)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .set_degradation_handler(on_degradation(!topic.is_view()))
            .create()
            .map_err(|e| IpcError::messaging("publish on", topic.name, e))?;
        let doorbell = topic.doorbell.map(|id| self.doorbell(id));
        let mut output = Output { publisher, doorbell, loan: None, topic: topic.name, counts: !topic.is_view(), ring: None };
        output.preloan();
        Ok(output)
    }

    fn input_of<T: Message>(&self, topic: &Topic<T>, wait: Wait, depth: usize) -> Result<Input<T>, IpcError> {
        let listener = if wait == Wait::Yes { topic.doorbell.map(|id| self.listener(id)) } else { None };
        let subscriber = self
            .service(topic)?
            .subscriber_builder()
            .buffer_size(depth)
            .history_request(topic.history)
            .set_degradation_handler(on_degradation(true))
            .create()
            .map_err(|e| IpcError::messaging("subscribe to", topic.name, e))?;
        Ok(Input { subscriber, listener, topic: topic.name, senders: Senders::default() })
    }

    /// Opens a receiver for control: a short buffer, of which the newest message counts.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] with the cause from iceoryx2.
    pub fn input<T: Message>(&self, topic: &Topic<T>, wait: Wait) -> Result<Input<T>, IpcError> {
        self.input_of(topic, wait, CONTROL_DEPTH)
    }

    /// Joins a topic and leaves it again, so that all its ports retry their failed connections.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] with the cause from iceoryx2.
    pub fn force_reconnect<T: Message>(&self, topic: &Topic<T>) -> Result<(), IpcError> {
        drop(self.input(topic, Wait::No)?);
        drop(self.bare_output(topic)?);
        Ok(())
    }

    /// Doorbell that wakes the waiting threads without a message: they check what has changed.
    #[must_use]
    pub fn doorbell(&self, id: DoorbellId) -> Doorbell {
        Doorbell::new(&self.page, id)
    }

    /// Listener for a doorbell without messages.
    #[must_use]
    pub fn listener(&self, id: DoorbellId) -> Listener {
        Listener::new(&self.page, id)
    }

    /// Opens a receiver for an observer, of a topic in [`view`](crate::topic::view); of the buffered messages the oldest
    /// are lost first.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] with the cause from iceoryx2.
    pub fn view_input<T: Message>(&self, topic: &Topic<T>) -> Result<Input<T>, IpcError> {
        self.input_of(topic, Wait::No, topic.depth)
    }

    /// Opens a receiver for the recorder: a deep buffer that must not overflow.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] with the cause from iceoryx2.
    pub fn recorder_input<T: Message>(&self, topic: &Topic<T>) -> Result<Input<T>, IpcError> {
        self.input_of(topic, Wait::No, topic.depth)
    }
}

pub(crate) fn service_name(name: &str) -> Result<ServiceName, IpcError> {
    name.try_into().map_err(|e| IpcError::Name { what: "a topic's name", value: name.to_owned(), cause: format!("{e:?}") })
}
