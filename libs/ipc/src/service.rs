//! Requests to a running stack and their replies: what `hapfic set`, `status` and `stop` ask, and any other program may.
//!
//! A request-response service, and a doorbell that wakes the one who answers. The service is made and held by the supervisor
//! ([`hold`]); callers only open it, so that one killed while it calls cannot damage it.

use crate::bus::{Bus, service_name};
use crate::doorbell::{Doorbell, Listener, Wakes};
use crate::error::IpcError;
use crate::topic;
use crate::wire::Wire;
use core::time::Duration;
use hapfic_messages::{Check, OperatorReply, OperatorRequest};
use iceoryx2::active_request::ActiveRequest;
use iceoryx2::port::client::Client;
use iceoryx2::port::server::Server;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::request_response;
use std::time::Instant;

type Transport = ipc::Service;
type Factory = request_response::PortFactory<Transport, Wire<OperatorRequest>, (), Wire<OperatorReply>, ()>;

/// Name of the service.
const NAME: &str = "operator_request";
/// Callers at a time; those that were killed count until they are swept.
const MAX_CALLERS: usize = 16;
/// Callers above which it is worth looking for dead ones.
const CROWD: usize = 4;
/// Nodes that may know the service: callers, the supervisor and its thread.
const MAX_NODES: usize = 32;
/// How often a caller looks for its reply.
const POLL_INTERVAL: Duration = Duration::from_millis(1);
/// Creates the service and keeps it in being as long as the returned guard lives.
///
/// # Errors
/// [`IpcError::Messaging`] with what iceoryx2 said.
pub fn keep_alive(bus: &Bus) -> Result<Box<dyn core::any::Any>, IpcError> {
    Ok(Box::new(made_service(bus)?))
}

fn made_service(bus: &Bus) -> Result<Factory, IpcError> {
    bus.node
        .service_builder(&service_name(NAME)?)
        .request_response::<Wire<OperatorRequest>, Wire<OperatorReply>>()
        .max_servers(1)
        .max_clients(MAX_CALLERS)
        .max_nodes(MAX_NODES)
        .max_active_requests_per_client(2)
        .max_response_buffer_size(2)
        // Who has given up waiting does not want it done any more.
        .enable_fire_and_forget_requests(false)
        .open_or_create()
        .map_err(|e| IpcError::messaging("open service", NAME, e))
}

/// The side that answers.
pub struct Requests {
    server: Server<Transport, Wire<OperatorRequest>, (), Wire<OperatorReply>, ()>,
    listener: Listener,
    factory: Factory,
}

/// A request that waits for its reply.
pub struct Asked {
    /// What was asked, copied out of shared memory; not checked yet.
    pub request: OperatorRequest,
    active: ActiveRequest<Transport, Wire<OperatorRequest>, (), Wire<OperatorReply>, ()>,
}

impl Requests {
    /// Opens the service.
    ///
    /// # Errors
    /// [`IpcError::Messaging`], also when somebody else answers already.
    pub fn open(bus: &Bus) -> Result<Self, IpcError> {
        let factory = made_service(bus)?;
        let server = factory
            .server_builder()
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| IpcError::messaging("answer on", NAME, e))?;
        Ok(Self { server, listener: bus.listener(topic::OPERATOR_REQUEST), factory })
    }

    /// The oldest request not taken yet.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] if a connection is damaged.
    pub fn take(&mut self) -> Result<Option<Asked>, IpcError> {
        let received = self.server.receive().map_err(|e| IpcError::messaging("receive on", NAME, e))?;
        Ok(received.map(|active| Asked { request: active.payload().0, active }))
    }

    /// Whether there are so many callers that some are probably dead; [`Bus::clean_up_dead_nodes`] then makes room.
    #[must_use]
    pub fn crowded(&self) -> bool {
        self.factory.dynamic_config().number_of_clients() > CROWD
    }
}

impl Wakes for Requests {
    fn listener(&self) -> Option<&Listener> {
        Some(&self.listener)
    }
}

impl Asked {
    /// Answers.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] if the caller cannot be reached.
    pub fn reply(self, reply: &OperatorReply) -> Result<(), IpcError> {
        self.active.send_copy(Wire(*reply)).map_err(|e| IpcError::messaging("reply on", NAME, e))
    }
}

/// The side that asks.
pub struct Caller {
    client: Client<Transport, Wire<OperatorRequest>, (), Wire<OperatorReply>, ()>,
    doorbell: Doorbell,
}

impl Caller {
    /// Opens the service of a run, which must be there.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] if it is not, or has all the callers it takes.
    pub fn open(bus: &Bus) -> Result<Self, IpcError> {
        let client = bus
            .node
            .service_builder(&service_name(NAME)?)
            .request_response::<Wire<OperatorRequest>, Wire<OperatorReply>>()
            .open()
            .map_err(|e| IpcError::messaging("open service", NAME, e))?
            .client_builder()
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| IpcError::messaging("ask on", NAME, e))?;
        Ok(Self { client, doorbell: bus.doorbell(topic::OPERATOR_REQUEST) })
    }

    /// Asks and waits for the reply; `None` if none came in time.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] if iceoryx2 fails, [`IpcError::Message`] if the reply cannot be used.
    pub fn ask(&self, request: &OperatorRequest, patience: Duration) -> Result<Option<OperatorReply>, IpcError> {
        let pending = self.client.send_copy(Wire(*request)).map_err(|e| IpcError::messaging("send on", NAME, e))?;
        // Whoever answers looks by itself, too; this only makes it sooner.
        self.doorbell.notify();
        let asked = Instant::now();
        loop {
            if let Some(response) = pending.receive().map_err(|e| IpcError::messaging("receive on", NAME, e))? {
                let reply = response.payload().0;
                reply.check().map_err(|defect| IpcError::Message { topic: NAME, defect })?;
                return Ok(Some(reply));
            }
            if asked.elapsed() > patience {
                return Ok(None);
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }
}

/// For a program that only asks: iceoryx2 shall not tell its user about services that come and go.
pub fn quiet() {
    set_log_level(LogLevel::Fatal);
}
