//! Operator requests to a running stack and their replies: `hapfic set`, `status`, `stop` and other programs send them.
//!
//! A request-response service, and a doorbell that wakes the server. Supervisor and gates create the service and keep it
//! alive ([`keep_alive`]). Callers only open it, so a caller killed in a call cannot damage it.

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
/// Servers at a time: the successor of several that have been lost before the clean-up.
const SERVERS: usize = 4;
/// Most callers at a time; killed callers count until their clean-up.
const MAX_CALLERS: usize = 16;
/// Number of callers above which a clean-up of dead ones is due.
const CLEAN_UP_ABOVE: usize = 4;
/// Most nodes of the service: callers, the supervisor and its thread, and the gates.
const MAX_NODES: usize = 32;
/// Poll interval of a caller for its reply.
const POLL_INTERVAL: Duration = Duration::from_millis(1);

/// Creates the service and keeps it alive until the returned guard drops.
///
/// # Errors
/// [`IpcError::Messaging`] with the cause from iceoryx2.
pub fn keep_alive(bus: &Bus) -> Result<Box<dyn core::any::Any>, IpcError> {
    Ok(Box::new(create_service(bus)?))
}

fn create_service(bus: &Bus) -> Result<Factory, IpcError> {
    bus.node
        .service_builder(&service_name(NAME)?)
        .request_response::<Wire<OperatorRequest>, Wire<OperatorReply>>()
        .max_servers(SERVERS)
        .max_clients(MAX_CALLERS)
        .max_nodes(MAX_NODES)
        .max_active_requests_per_client(2)
        .max_response_buffer_size(2)
        // A request whose caller has timed out must not be executed.
        .enable_fire_and_forget_requests(false)
        .open_or_create()
        .map_err(|e| IpcError::messaging("open service", NAME, e))
}

/// Server of the requests.
pub struct RequestServer {
    server: Server<Transport, Wire<OperatorRequest>, (), Wire<OperatorReply>, ()>,
    listener: Listener,
    factory: Factory,
}

/// Request that waits for its reply.
pub struct PendingRequest {
    /// The request, copied out of shared memory and not checked yet.
    pub request: OperatorRequest,
    active: ActiveRequest<Transport, Wire<OperatorRequest>, (), Wire<OperatorReply>, ()>,
}

impl RequestServer {
    /// Opens the service.
    ///
    /// # Errors
    /// [`IpcError::Messaging`], also when the service has its full number of servers, living and dead.
    pub fn open(bus: &Bus) -> Result<Self, IpcError> {
        let factory = create_service(bus)?;
        let server = factory
            .server_builder()
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| IpcError::messaging("serve", NAME, e))?;
        Ok(Self { server, listener: bus.listener(topic::OPERATOR_REQUEST), factory })
    }

    /// Takes the oldest request.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] if a connection is damaged.
    pub fn take(&mut self) -> Result<Option<PendingRequest>, IpcError> {
        let received = self.server.receive().map_err(|e| IpcError::messaging("receive on", NAME, e))?;
        Ok(received.map(|active| PendingRequest { request: active.payload().0, active }))
    }

    /// Whether there are so many callers that some are probably dead; [`Bus::clean_up_dead_nodes`] then removes these.
    #[must_use]
    pub fn needs_clean_up(&self) -> bool {
        self.factory.dynamic_config().number_of_clients() > CLEAN_UP_ABOVE
    }
}

impl Wakes for RequestServer {
    fn listener(&self) -> Option<&Listener> {
        Some(&self.listener)
    }
}

impl PendingRequest {
    /// Sends the reply.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] if the caller cannot be reached.
    pub fn reply(self, reply: &OperatorReply) -> Result<(), IpcError> {
        self.active.send_copy(Wire(*reply)).map_err(|e| IpcError::messaging("reply on", NAME, e))
    }
}

/// Client of the requests.
pub struct RequestClient {
    client: Client<Transport, Wire<OperatorRequest>, (), Wire<OperatorReply>, ()>,
    doorbell: Doorbell,
}

impl RequestClient {
    /// Opens the service of a run, which must exist.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] if it does not, or has its full number of callers.
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
            .map_err(|e| IpcError::messaging("send requests on", NAME, e))?;
        Ok(Self { client, doorbell: bus.doorbell(topic::OPERATOR_REQUEST) })
    }

    /// Sends a request and waits for the reply; `None` if none came in time.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] if iceoryx2 fails, [`IpcError::Message`] if the reply cannot be used.
    pub fn ask(&self, request: &OperatorRequest, timeout: Duration) -> Result<Option<OperatorReply>, IpcError> {
        let pending = self.client.send_copy(Wire(*request)).map_err(|e| IpcError::messaging("send on", NAME, e))?;
        // The server also polls; this only makes it faster.
        self.doorbell.notify();
        let sent = Instant::now();
        loop {
            if let Some(response) = pending.receive().map_err(|e| IpcError::messaging("receive on", NAME, e))? {
                let reply = response.payload().0;
                reply.check().map_err(|defect| IpcError::Message { topic: NAME, defect })?;
                return Ok(Some(reply));
            }
            if sent.elapsed() > timeout {
                return Ok(None);
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }
}

/// Silences iceoryx2's log below fatal errors: a user need not see services that come and go.
pub fn silence_transport_log() {
    set_log_level(LogLevel::Fatal);
}
