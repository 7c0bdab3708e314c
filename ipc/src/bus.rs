//! Ports over iceoryx2.
//!
//! Each topic is a publish-subscribe service and, where someone waits for it, an event service of the same name. Sending makes
//! no system call but the notification and no heap allocation: the sample is loaned beforehand, in the slack
//! ([`Output::prepare`]).

use crate::clock;
use crate::error::IpcError;
use crate::run::Clock;
use crate::topic::{CONTROL_DEPTH, RECORDER_DEPTH, Topic};
use core::mem::MaybeUninit;
use core::time::Duration;
use iceoryx2::config::Config;
use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use rustix::event::{PollFd, PollFlags, poll};
use std::os::fd::BorrowedFd;

type Service = ipc::Service;

/// Most that may take part in a topic at a time.
const MAX_NODES: usize = 32;
const MAX_SUBSCRIBERS: usize = 12;
const MAX_LISTENERS: usize = 12;
/// Places for those that only wake others.
const KNOCKERS: usize = 2;
/// Most inputs one may wait for at once.
const MAX_WAITS: usize = 4;

/// A run's own corner of the machine: nothing in it is seen by another run.
#[derive(Clone, Debug)]
pub struct Domain {
    config: Config,
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
        Ok(Self { config })
    }

    /// The same corner for those who live on while others die: they wait only so long for a connection that another has begun to make.
    /// One who was killed in the middle never finishes it, and iceoryx2 would wait for him for a second, in the middle of a tick.
    /// What could not be met counts as [unmet](Output::unmet) and is tried again when somebody joins or leaves.
    #[must_use]
    pub fn hasty(&self, clock: Clock) -> Self {
        let mut config = self.config.clone();
        config.global.creation_timeout = match clock {
            Clock::Realtime => Duration::from_millis(5),
            Clock::Lockstep => Duration::from_millis(200),
        };
        Self { config }
    }
}

/// Whether an input can be waited for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wait {
    /// It takes part in [`wait`].
    Yes,
    /// It is only looked at.
    No,
}

/// A process's, or a thread's, access to the topics. Not shared between threads: each opens its own.
#[derive(Debug)]
pub struct Bus {
    pub(crate) node: Node<Service>,
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
        Ok(Self { node })
    }

    /// Removes what killed processes have left in the domain: milliseconds, and not for real-time threads.
    pub fn sweep_dead(&self) {
        // What cannot be removed now is removed with the whole domain at the end of the run.
        let _ = self.node.try_cleanup_dead_nodes();
    }

    fn service<T: Copy + core::fmt::Debug + ZeroCopySend + 'static>(
        &self,
        topic: &Topic<T>,
    ) -> Result<iceoryx2::service::port_factory::publish_subscribe::PortFactory<Service, T, ()>, IpcError> {
        self.node
            .service_builder(&service_name(topic.name)?)
            .publish_subscribe::<T>()
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

    fn event<T>(&self, topic: &Topic<T>) -> Result<iceoryx2::service::port_factory::event::PortFactory<Service>, IpcError> {
        self.node
            .service_builder(&service_name(topic.name)?)
            .event()
            .max_notifiers(topic.publishers + KNOCKERS)
            .max_listeners(MAX_LISTENERS)
            .max_nodes(MAX_NODES)
            .open_or_create()
            .map_err(|e| IpcError::messaging("open event", topic.name, e))
    }

    /// Creates a topic and keeps it in being as long as the returned guard lives. Who creates first must outlive the others:
    /// a process killed while it creates a service can leave it unusable.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] with what iceoryx2 said.
    pub fn hold<T: Copy + core::fmt::Debug + ZeroCopySend + 'static>(
        &self,
        topic: &Topic<T>,
    ) -> Result<Box<dyn core::any::Any>, IpcError> {
        let service = self.service(topic)?;
        let event = if topic.wakes { Some(self.event(topic)?) } else { None };
        Ok(Box::new((service, event)))
    }

    /// A sender.
    ///
    /// # Errors
    /// [`IpcError::Messaging`], also when the topic has all the publishers it takes.
    pub fn output<T: Copy + core::fmt::Debug + ZeroCopySend + 'static>(&self, topic: &Topic<T>) -> Result<Output<T>, IpcError> {
        let publisher = self
            .service(topic)?
            .publisher_builder()
            .max_loaned_samples(2)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| IpcError::messaging("publish on", topic.name, e))?;
        let notifier = if topic.wakes {
            Some(self.event(topic)?.notifier_builder().create().map_err(|e| IpcError::messaging("notify on", topic.name, e))?)
        } else {
            None
        };
        let mut output = Output { publisher, notifier, loan: None, topic: topic.name, unmet: 0 };
        output.prepare();
        Ok(output)
    }

    fn input_of<T: Copy + core::fmt::Debug + ZeroCopySend + 'static>(
        &self,
        topic: &Topic<T>,
        wait: Wait,
        depth: usize,
    ) -> Result<Input<T>, IpcError> {
        let listener = if wait == Wait::Yes && topic.wakes {
            Some(self.event(topic)?.listener_builder().create().map_err(|e| IpcError::messaging("listen on", topic.name, e))?)
        } else {
            None
        };
        let subscriber = self
            .service(topic)?
            .subscriber_builder()
            .buffer_size(depth)
            .history_request(topic.history)
            .create()
            .map_err(|e| IpcError::messaging("subscribe to", topic.name, e))?;
        Ok(Input { subscriber, listener, topic: topic.name, unmet: 0 })
    }

    /// A receiver for control: a short buffer of which the newest counts.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] with what iceoryx2 said.
    pub fn input<T: Copy + core::fmt::Debug + ZeroCopySend + 'static>(
        &self,
        topic: &Topic<T>,
        wait: Wait,
    ) -> Result<Input<T>, IpcError> {
        self.input_of(topic, wait, CONTROL_DEPTH)
    }

    /// Joins a topic and leaves it again: so that all that are in it look round once more for those they could not meet.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] with what iceoryx2 said.
    pub fn stir<T: Copy + core::fmt::Debug + ZeroCopySend + 'static>(&self, topic: &Topic<T>) -> Result<(), IpcError> {
        drop(self.input(topic, Wait::No)?);
        drop(self.output(topic)?);
        Ok(())
    }

    /// A way to wake those who wait for a topic without sending anything: they look around and find what has changed.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] with what iceoryx2 said.
    pub fn knocker<T: Copy + core::fmt::Debug + ZeroCopySend + 'static>(&self, topic: &Topic<T>) -> Result<Knocker, IpcError> {
        let notifier =
            self.event(topic)?.notifier_builder().create().map_err(|e| IpcError::messaging("notify on", topic.name, e))?;
        Ok(Knocker(notifier))
    }

    /// A receiver for the recorder: a deep buffer that must not overflow.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] with what iceoryx2 said.
    pub fn recorder_input<T: Copy + core::fmt::Debug + ZeroCopySend + 'static>(
        &self,
        topic: &Topic<T>,
    ) -> Result<Input<T>, IpcError> {
        self.input_of(topic, Wait::No, RECORDER_DEPTH)
    }
}

pub(crate) fn service_name(name: &str) -> Result<ServiceName, IpcError> {
    name.try_into().map_err(|e| IpcError::Name { what: "a topic's name", value: name.to_owned(), cause: format!("{e:?}") })
}

/// Wakes those who wait for a topic.
#[derive(Debug)]
pub struct Knocker(Notifier<Service>);

impl Knocker {
    /// Work for the slack: meets those who have joined since.
    pub fn prepare(&self) {
        // As for a sender: one that cannot be met looks by itself.
        let _ = self.0.update_connections();
    }

    /// Wakes them all.
    pub fn knock(&self) {
        // A listener that has just died is not the caller's concern.
        let _ = self.0.notify();
    }
}

/// A sender of one topic.
pub struct Output<T: Copy + core::fmt::Debug + ZeroCopySend + 'static> {
    publisher: Publisher<Service, T, ()>,
    notifier: Option<Notifier<Service>>,
    loan: Option<SampleMutUninit<Service, MaybeUninit<T>, ()>>,
    topic: &'static str,
    unmet: u32,
}

impl<T: Copy + core::fmt::Debug + ZeroCopySend + 'static> core::fmt::Debug for Output<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Output").field("topic", &self.topic).field("loan", &self.loan.is_some()).finish()
    }
}

impl<T: Copy + core::fmt::Debug + ZeroCopySend + 'static> Output<T> {
    /// Work for the slack: loans the sample that the next [`send`](Self::send) will fill (one heap allocation), and lets those
    /// in who have joined since (history is handed over here).
    pub fn prepare(&mut self) {
        self.meet();
        if let Some(notifier) = &self.notifier {
            // One that cannot be met is not woken: it looks by itself from time to time.
            let _ = notifier.update_connections();
        }
        // A failure shows at the next send, which then has no loan.
        if self.loan.is_none() {
            self.loan = self.publisher.loan_uninit().ok();
        }
    }

    fn meet(&mut self) {
        self.unmet += u32::from(self.publisher.update_connections().is_err());
    }

    /// How often somebody who had joined could not be met.
    #[must_use]
    pub fn unmet(&self) -> u32 {
        self.unmet
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
        self.meet();
        loan.write_payload(*message).send().map_err(|e| IpcError::messaging("send on", self.topic, e))?;
        let published = clock::now_ns();
        if let Some(notifier) = &self.notifier {
            // A listener that has just died is not the sender's concern.
            let _ = notifier.notify();
        }
        Ok(published)
    }
}

/// A receiver of one topic.
#[derive(Debug)]
pub struct Input<T: Copy + core::fmt::Debug + ZeroCopySend + 'static> {
    subscriber: Subscriber<Service, T, ()>,
    listener: Option<Listener<Service>>,
    topic: &'static str,
    unmet: u32,
}

impl<T: Copy + core::fmt::Debug + ZeroCopySend + 'static> Input<T> {
    /// The oldest message not taken yet, copied out of shared memory so that no sender can change it afterwards.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] if a connection is damaged.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> Result<Option<T>, IpcError> {
        // As in sending: one that cannot be met costs nobody else's messages.
        self.prepare();
        match self.subscriber.receive() {
            Ok(sample) => Ok(sample.map(|s| *s)),
            Err(e) => Err(IpcError::messaging("receive on", self.topic, e)),
        }
    }

    /// Work for the slack: meets those who have joined since, so that the next [`next`](Self::next) need not.
    pub fn prepare(&mut self) {
        self.unmet += u32::from(self.subscriber.update_connections().is_err());
    }

    /// How often somebody who had joined could not be met.
    #[must_use]
    pub fn unmet(&self) -> u32 {
        self.unmet
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

/// Something to wait for. Implemented by [`Input`].
pub trait Wakes {
    /// The listener, if there is one.
    #[doc(hidden)]
    fn listener(&self) -> Option<&Listener<ipc::Service>>;
}

impl<T: Copy + core::fmt::Debug + ZeroCopySend + 'static> Wakes for Input<T> {
    fn listener(&self) -> Option<&Listener<ipc::Service>> {
        self.listener.as_ref()
    }
}

/// Waits until something was sent to one of the inputs, a signal came, or the time is up; at once if something was sent since
/// the last wait. Wake-ups coalesce, so take everything there is afterwards; and they may be spurious.
///
/// Inputs opened with [`Wait::No`] are passed over. At most four can be waited for. Says whether anything woke it.
///
/// # Errors
/// [`IpcError::System`] if polling fails.
pub fn wait(inputs: &[&dyn Wakes], timeout: Duration) -> Result<bool, IpcError> {
    let mut listeners: [Option<&Listener<Service>>; MAX_WAITS] = [None; MAX_WAITS];
    let mut count = 0;
    for listener in inputs.iter().filter_map(|i| i.listener()).take(MAX_WAITS) {
        listeners[count] = Some(listener);
        count += 1;
    }
    // A listener that was told something while its last wake-up was being taken away has nothing in its socket, and nobody will
    // put anything there until it is asked: so ask first, then poll.
    if take_wake_ups(&listeners[..count]) {
        return Ok(true);
    }
    let mut fds = listeners.map(|listener| {
        // An unused place polls no file; descriptor 0 with no flags asked for is never looked at beyond the count below.
        let raw = listener.map_or(0, |l| {
            // SAFETY: the descriptor is only borrowed, for as long as the listener that owns it is.
            unsafe { l.file_descriptor().native_handle() }
        });
        // SAFETY: `raw` stays open while `listeners` borrows its owner (or is standard input, and then not polled).
        PollFd::from_borrowed_fd(unsafe { BorrowedFd::borrow_raw(raw) }, PollFlags::IN)
    });
    let time = clock::timespec(timeout.as_nanos() as u64);
    match poll(&mut fds[..count], Some(&time)) {
        Ok(0) | Err(rustix::io::Errno::INTR) => Ok(false),
        Ok(_) => {
            take_wake_ups(&listeners[..count]);
            Ok(true)
        }
        Err(e) => Err(IpcError::System { action: "wait for a message", cause: e.into() }),
    }
}

/// Takes pending wake-ups away; the messages themselves are in the subscribers. Says whether there were any.
fn take_wake_ups(listeners: &[Option<&Listener<Service>>]) -> bool {
    let mut any = false;
    for listener in listeners.iter().flatten() {
        // An error would show at the poll.
        any |= listener.try_wait(|_| {}).is_ok_and(|count| count > 0);
    }
    any
}
