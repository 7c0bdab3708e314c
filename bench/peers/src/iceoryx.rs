//! iceoryx2 as it comes: publish-subscribe for the message, its own event service for the wake-up; without what HapFIC adds.

use crate::place;
use hapfic_diagnostics::{Kind, Link, Seat};
use iceoryx2::config::Config;
use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use std::fmt::Debug;
use std::io;
use std::time::{Duration, Instant};

type Service = ipc::Service;

/// The kind of chain.
pub struct IceoryxEvent;

impl Kind for IceoryxEvent {
    fn name(&self) -> &'static str {
        "iceoryx2-event"
    }

    fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>> {
        set_log_level(LogLevel::Error);
        let mut config = Config::default();
        config.global.prefix = FileName::new(format!("{}_", seat.chain).as_bytes()).map_err(failed)?;
        let root = place::folder(&seat.chain)?;
        config.global.set_root_path(&iceoryx2::prelude::Path::new(root.to_string_lossy().as_bytes()).map_err(failed)?);
        let node = NodeBuilder::new().config(&config).create::<Service>().map_err(failed)?;

        let to = service(seat.place)?;
        let messages = node.service_builder(&to).publish_subscribe::<[u8]>().open_or_create().map_err(failed)?;
        let publisher = messages.publisher_builder().initial_max_slice_len(seat.longest()).create().map_err(failed)?;
        let events = node.service_builder(&to).event().open_or_create().map_err(failed)?;
        let notifier = events.notifier_builder().create().map_err(failed)?;

        let from = service(seat.before())?;
        let messages = node.service_builder(&from).publish_subscribe::<[u8]>().open_or_create().map_err(failed)?;
        let subscriber = messages.subscriber_builder().create().map_err(failed)?;
        let events = node.service_builder(&from).event().open_or_create().map_err(failed)?;
        let listener = events.listener_builder().create().map_err(failed)?;
        Ok(Box::new(Joined { publisher, notifier, subscriber, listener, _node: node }))
    }
}

fn service(place: usize) -> io::Result<ServiceName> {
    format!("from-{place}").as_str().try_into().map_err(failed)
}

fn failed(cause: impl Debug) -> io::Error {
    io::Error::other(format!("iceoryx2: {cause:?}"))
}

struct Joined {
    publisher: Publisher<Service, [u8], ()>,
    notifier: Notifier<Service>,
    subscriber: Subscriber<Service, [u8], ()>,
    listener: Listener<Service>,
    _node: Node<Service>,
}

impl Link for Joined {
    fn send(&mut self, message: &[u8]) -> io::Result<()> {
        let sample = self.publisher.loan_slice_uninit(message.len()).map_err(failed)?;
        sample.write_from_slice(message).send().map_err(failed)?;
        self.notifier.notify().map_err(failed)?;
        Ok(())
    }

    fn receive(&mut self, into: &mut [u8], timeout: Option<Duration>) -> io::Result<usize> {
        let deadline = timeout.map(|timeout| Instant::now() + timeout);
        loop {
            if let Some(sample) = self.subscriber.receive().map_err(failed)? {
                let length = sample.len();
                let place = into.get_mut(..length).ok_or_else(|| failed("a message longer than all that are sent"))?;
                place.copy_from_slice(&sample);
                return Ok(length);
            }
            match deadline.map(|deadline| deadline.saturating_duration_since(Instant::now())) {
                Some(Duration::ZERO) => return Ok(0),
                Some(left) => self.listener.timed_wait(|_| {}, left).map_err(failed)?,
                None => self.listener.blocking_wait(|_| {}).map_err(failed)?,
            };
        }
    }
}
