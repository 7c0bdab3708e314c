//! Ports of a topic: the sender and the receiver.

use crate::clock;
use crate::doorbell::{Doorbell, Listener, Wakes};
use crate::error::IpcError;
use crate::memory::Senders;
use crate::message_ring::MessageRing;
use crate::wire::Wire;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicU32, Ordering};
use hapfic_messages::Message;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::port::{DegradationAction, DegradationCause, DegradationInfo, ReceiveError};
use iceoryx2::prelude::*;
use iceoryx2::sample_mut_uninit::SampleMutUninit;

type Service = ipc::Service;

/// Failed connections of this process.
static FAILED_CONNECTIONS: AtomicU32 = AtomicU32::new(0);

/// Number of failed connections of the ports of this process. Its heartbeat reports them, and the supervisor lets all ports
/// connect again.
#[must_use]
pub fn failed_connections() -> u32 {
    FAILED_CONNECTIONS.load(Ordering::Relaxed)
}

fn count_failed(failed: bool) {
    if failed {
        FAILED_CONNECTIONS.fetch_add(1, Ordering::Relaxed);
    }
}

/// What a port does with a connection that fails: it is counted, if it `counts`, and the others go on. By its default
/// iceoryx2 logs a warning and tells nobody.
pub(crate) fn on_degradation(counts: bool) -> impl Fn(DegradationCause, &DegradationInfo) -> DegradationAction + Send + 'static {
    move |_, _| {
        count_failed(counts);
        DegradationAction::Ignore
    }
}

/// Sender of a topic.
pub struct Output<T: Message> {
    pub(crate) publisher: Publisher<Service, Wire<T>, ()>,
    pub(crate) doorbell: Option<Doorbell>,
    pub(crate) loan: Option<SampleMutUninit<Service, MaybeUninit<Wire<T>>, ()>>,
    pub(crate) topic: &'static str,
    /// Whether a failed connection counts: that of an observer is the observer's.
    pub(crate) counts: bool,
    /// Last messages, which outlive the sender.
    pub(crate) ring: Option<MessageRing<T>>,
}

// SAFETY: only a reference count that is not atomic keeps a port of `ipc::Service` on one thread (iceoryx2 0.10, to
// which this workspace is pinned: `arc_sync_policy::SingleThreaded`, an `Rc` of a state that is itself `Send`; nodes
// and services are counted by `Arc`; no handler of this workspace is in it). Only the publisher and the loan in here
// count, and they move between threads together.
unsafe impl<T: Message> Send for Output<T> {}

impl<T: Message> core::fmt::Debug for Output<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Output").field("topic", &self.topic).field("loan", &self.loan.is_some()).finish()
    }
}

impl<T: Message> Output<T> {
    /// Loans the sample that the next [`send`](Self::send) fills (one heap allocation), and connects to new receivers,
    /// which get the history. Idle-time work.
    pub fn preloan(&mut self) {
        self.update_connections();
        // A failure shows at the next send, which then has no loan.
        if self.loan.is_none() {
            self.loan = self.publisher.loan_uninit().ok();
        }
    }

    /// Warms up the caches: writes a message where the next one will be written, and sends nothing. Idle-time work,
    /// since it allocates as [`preloan`](Self::preloan) does.
    pub fn warm_up(&mut self, message: &T) {
        self.preloan();
        if let Some(loan) = &mut self.loan {
            loan.payload_mut().write(Wire(*message));
        }
        // A second loan reclaims what receivers have returned, as sending does.
        drop(self.publisher.loan_uninit());
    }

    fn update_connections(&mut self) {
        count_failed(self.publisher.update_connections().is_err() && self.counts);
    }

    /// Sends a message and wakes the threads waiting for it. What outlives the sender is written first.
    ///
    /// Returns the monotonic time at which the message was readable [ns]. The clock is read before the wake-up, since a
    /// woken thread may take the processor immediately.
    ///
    /// # Errors
    /// [`IpcError::NoLoan`] if all memory is on loan; [`IpcError::Messaging`] if iceoryx2 fails.
    pub fn send(&mut self, message: &T) -> Result<u64, IpcError> {
        if let Some(ring) = &self.ring {
            ring.push(message);
        }
        self.send_again(message)
    }

    /// Sends a message of a predecessor, whose last messages have outlived it.
    ///
    /// # Errors
    /// As [`send`](Self::send).
    pub fn send_again(&mut self, message: &T) -> Result<u64, IpcError> {
        let loan = match self.loan.take() {
            Some(loan) => loan,
            None => self.publisher.loan_uninit().map_err(|_| IpcError::NoLoan { topic: self.topic })?,
        };
        // A connection to a receiver that died while connecting fails. That must not cost this message; one attempt
        // suffices.
        self.update_connections();
        loan.write_payload(Wire(*message)).send().map_err(|e| IpcError::messaging("send on", self.topic, e))?;
        let published = clock::now_ns();
        if let Some(doorbell) = &self.doorbell {
            doorbell.notify();
        }
        Ok(published)
    }
}

/// Receiver of a topic.
#[derive(Debug)]
pub struct Input<T: Message> {
    pub(crate) subscriber: Subscriber<Service, Wire<T>, ()>,
    pub(crate) listener: Option<Listener>,
    pub(crate) topic: &'static str,
    pub(crate) senders: Senders,
}

// SAFETY: as with outputs; samples do not outlive the call that takes them.
unsafe impl<T: Message> Send for Input<T> {}

impl<T: Message> Input<T> {
    /// Takes the oldest message, copied out of shared memory so that no sender can change it afterwards.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] if a connection is damaged.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> Result<Option<T>, IpcError> {
        let received = match self.subscriber.receive() {
            // As in sending: a failed connection must not cost the messages of other senders.
            Err(ReceiveError::ConnectionFailure(_)) => {
                count_failed(true);
                self.subscriber.receive()
            }
            received => received,
        };
        match received {
            Ok(None) => Ok(None),
            Ok(Some(sample)) => {
                self.senders.observe(sample.payload(), sample.origin());
                Ok(Some(sample.0))
            }
            Err(e) => Err(IpcError::messaging("receive on", self.topic, e)),
        }
    }

    /// Connects to new senders, so that [`next`](Self::next) need not, and prefaults the memory of their messages.
    /// Idle-time work.
    pub fn update_connections(&mut self) {
        self.senders.prefault::<T>();
        count_failed(self.subscriber.update_connections().is_err());
    }

    /// Discards earlier notifications: they do not end the next wait.
    pub fn discard_notifications(&self) {
        if let Some(listener) = &self.listener {
            listener.discard_notifications();
        }
    }

    /// Takes the newest message, if any came since the last call.
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
