//! iceoryx2 with default settings: publish-subscribe for messages, its own event service for wake-ups.

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

/// Chain over iceoryx2.
pub struct IceoryxEvent;

impl Kind for IceoryxEvent {
    fn name(&self) -> &'static str {
        "iceoryx2-event"
    }

    fn join(&self, seat: Seat) -> io::Result<Box<dyn Link>> {
        set_log_level(LogLevel::Error);
        let mut config = Config::default();
        config.global.prefix = FileName::new(format!("{}_", seat.chain).as_bytes()).map_err(to_io_error)?;
        let root = place::folder(&seat.chain)?;
        config.global.set_root_path(&iceoryx2::prelude::Path::new(root.to_string_lossy().as_bytes()).map_err(to_io_error)?);
        let node = NodeBuilder::new().config(&config).create::<Service>().map_err(to_io_error)?;

        let to = service(seat.stage)?;
        let messages = node.service_builder(&to).publish_subscribe::<[u8]>().open_or_create().map_err(to_io_error)?;
        let publisher = messages.publisher_builder().initial_max_slice_len(seat.longest()).create().map_err(to_io_error)?;
        let events = node.service_builder(&to).event().open_or_create().map_err(to_io_error)?;
        let notifier = events.notifier_builder().create().map_err(to_io_error)?;

        let from = service(seat.before())?;
        let messages = node.service_builder(&from).publish_subscribe::<[u8]>().open_or_create().map_err(to_io_error)?;
        let subscriber = messages.subscriber_builder().create().map_err(to_io_error)?;
        let events = node.service_builder(&from).event().open_or_create().map_err(to_io_error)?;
        let listener = events.listener_builder().create().map_err(to_io_error)?;
        Ok(Box::new(IceoryxLink { publisher, notifier, subscriber, listener, _node: node }))
    }
}

fn service(stage: usize) -> io::Result<ServiceName> {
    format!("from-{stage}").as_str().try_into().map_err(to_io_error)
}

fn to_io_error(cause: impl Debug) -> io::Error {
    io::Error::other(format!("iceoryx2: {cause:?}"))
}

struct IceoryxLink {
    publisher: Publisher<Service, [u8], ()>,
    notifier: Notifier<Service>,
    subscriber: Subscriber<Service, [u8], ()>,
    listener: Listener<Service>,
    _node: Node<Service>,
}

impl Link for IceoryxLink {
    fn send(&mut self, message: &[u8]) -> io::Result<()> {
        let sample = self.publisher.loan_slice_uninit(message.len()).map_err(to_io_error)?;
        sample.write_from_slice(message).send().map_err(to_io_error)?;
        self.notifier.notify().map_err(to_io_error)?;
        Ok(())
    }

    fn receive(&mut self, into: &mut [u8], timeout: Option<Duration>) -> io::Result<usize> {
        let deadline = timeout.map(|timeout| Instant::now() + timeout);
        loop {
            if let Some(sample) = self.subscriber.receive().map_err(to_io_error)? {
                let length = sample.len();
                let buffer =
                    into.get_mut(..length).ok_or_else(|| to_io_error("found a message longer than the longest of the chain"))?;
                buffer.copy_from_slice(&sample);
                return Ok(length);
            }
            match deadline.map(|deadline| deadline.saturating_duration_since(Instant::now())) {
                Some(Duration::ZERO) => return Ok(0),
                Some(remaining) => self.listener.timed_wait(|_| {}, remaining).map_err(to_io_error)?,
                None => self.listener.blocking_wait(|_| {}).map_err(to_io_error)?,
            };
        }
    }
}
