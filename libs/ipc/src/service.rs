//! Requests to a running stack and their replies: what `hapfic set`, `status` and `stop` ask, and any other program may.
//!
//! A request-response service, and a bell that wakes the one who answers. The service is made and held by the supervisor
//! ([`hold`]); callers only open it, so that one killed while it calls cannot damage it.

use crate::bell::{Bell, Listener, Wakes};
use crate::bus::{Bus, service_name};
use crate::check::{Check, Defect};
use crate::error::IpcError;
use crate::topic;
use crate::wire_enum::wire_enum;
use core::time::Duration;
use iceoryx2::active_request::ActiveRequest;
use iceoryx2::port::client::Client;
use iceoryx2::port::server::Server;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::request_response;
use std::time::Instant;

type Transport = ipc::Service;
type Factory = request_response::PortFactory<Transport, OperatorRequest, (), OperatorReply, ()>;

/// Name of the service.
const NAME: &str = "operator_request";
/// Callers at a time; those that were killed count until they are swept.
const MAX_CALLERS: usize = 16;
/// Callers above which it is worth looking for dead ones.
const CROWD: usize = 4;
/// Nodes that may know the service: callers, the supervisor and its thread.
const MAX_NODES: usize = 32;
/// How often a caller looks for its reply.
const LOOK_EVERY: Duration = Duration::from_millis(1);
/// Most bytes of text in an [`OperatorRequest`].
pub const REQUEST_TEXT: usize = 2048;
/// Most bytes of text in an [`OperatorReply`].
pub const REPLY_TEXT: usize = 4096;

wire_enum! {
    /// What is asked for.
    OperatorKind {
        /// Change parameters; the text holds `key=value` pairs, separated by NUL.
        Set = 1, "set";
        /// Tell how the run is; the reply's text is JSON.
        Status = 2, "status";
        /// End the run.
        Stop = 3, "stop";
        /// Latched stop: the drive brakes until somebody re-arms.
        EmergencyStop = 4, "estop";
        /// Leave a latched stop.
        Rearm = 5, "rearm";
        /// Make a fault on purpose; the text holds `key=value` pairs, separated by NUL.
        Inject = 6, "inject";
    }
}

wire_enum! {
    /// How a request was answered.
    ReplyCode {
        /// It is done, or will be at the tick that the reply names.
        Done = 1, "done";
        /// It cannot be done; nothing has changed, and the text says why.
        Refused = 2, "refused";
    }
}

/// What somebody asks of a running stack.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[type_name("hapfic.OperatorRequest")]
#[repr(C)]
pub struct OperatorRequest {
    /// Code of [`OperatorKind`].
    pub kind: u32,
    /// Bytes of `text` that count.
    pub text_len: u32,
    /// UTF-8.
    pub text: [u8; REQUEST_TEXT],
}

/// The answer.
#[derive(Clone, Copy, Debug, PartialEq, ZeroCopySend)]
#[type_name("hapfic.OperatorReply")]
#[repr(C)]
pub struct OperatorReply {
    /// Version of the parameters that were made; zero if none were.
    pub version: u64,
    /// First tick at which they are in force; -1 if there are none.
    pub tick: i64,
    /// Tick that was due when the request arrived at the supervisor.
    pub arrived_tick: i64,
    /// Tick that was due when the gate took it; -1 if it did not.
    pub taken_tick: i64,
    /// Code of [`ReplyCode`].
    pub code: u32,
    /// Bytes of `text` that count.
    pub text_len: u32,
    /// UTF-8.
    pub text: [u8; REPLY_TEXT],
}

fn length(found: usize, most: usize) -> Result<(), Defect> {
    if found <= most { Ok(()) } else { Err(Defect::Count { field: "text_len", found: found as u64, expected: most as u64 }) }
}

fn utf8(bytes: &[u8], len: u32) -> Result<&str, Defect> {
    length(len as usize, bytes.len())?;
    core::str::from_utf8(&bytes[..len as usize]).map_err(|_| Defect::Text { field: "text" })
}

impl OperatorRequest {
    /// A request.
    ///
    /// # Errors
    /// [`Defect::Count`] if the text is longer than [`REQUEST_TEXT`] bytes.
    pub fn new(kind: OperatorKind, text: &str) -> Result<Self, Defect> {
        length(text.len(), REQUEST_TEXT)?;
        let mut bytes = [0; REQUEST_TEXT];
        bytes[..text.len()].copy_from_slice(text.as_bytes());
        Ok(Self { kind: kind.code(), text_len: text.len() as u32, text: bytes })
    }

    /// Kind and text.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn parts(&self) -> Result<(OperatorKind, &str), Defect> {
        let kind = OperatorKind::from_code(self.kind).ok_or(Defect::Code { field: "kind", found: self.kind })?;
        Ok((kind, utf8(&self.text, self.text_len)?))
    }
}

impl Check for OperatorRequest {
    fn check(&self) -> Result<(), Defect> {
        self.parts().map(drop)
    }
}

impl OperatorReply {
    /// A reply without parameters; its text is cut at [`REPLY_TEXT`] bytes (at a character's border).
    #[must_use]
    pub fn new(code: ReplyCode, text: &str) -> Self {
        let len = text.floor_char_boundary(REPLY_TEXT);
        let mut bytes = [0; REPLY_TEXT];
        bytes[..len].copy_from_slice(&text.as_bytes()[..len]);
        Self { version: 0, tick: -1, arrived_tick: -1, taken_tick: -1, code: code.code(), text_len: len as u32, text: bytes }
    }

    /// Code and text.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn parts(&self) -> Result<(ReplyCode, &str), Defect> {
        let code = ReplyCode::from_code(self.code).ok_or(Defect::Code { field: "code", found: self.code })?;
        Ok((code, utf8(&self.text, self.text_len)?))
    }
}

impl Check for OperatorReply {
    fn check(&self) -> Result<(), Defect> {
        self.parts().map(drop)
    }
}

/// Creates the service and keeps it in being as long as the returned guard lives.
///
/// # Errors
/// [`IpcError::Messaging`] with what iceoryx2 said.
pub fn hold(bus: &Bus) -> Result<Box<dyn core::any::Any>, IpcError> {
    Ok(Box::new(made_service(bus)?))
}

fn made_service(bus: &Bus) -> Result<Factory, IpcError> {
    bus.node
        .service_builder(&service_name(NAME)?)
        .request_response::<OperatorRequest, OperatorReply>()
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
    server: Server<Transport, OperatorRequest, (), OperatorReply, ()>,
    listener: Listener,
    factory: Factory,
}

/// A request that waits for its reply.
pub struct Asked {
    /// What was asked, copied out of shared memory; not checked yet.
    pub request: OperatorRequest,
    active: ActiveRequest<Transport, OperatorRequest, (), OperatorReply, ()>,
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
        Ok(Self { server, listener: bus.listener(topic::ASKED), factory })
    }

    /// The oldest request not taken yet.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] if a connection is damaged.
    pub fn take(&mut self) -> Result<Option<Asked>, IpcError> {
        let received = self.server.receive().map_err(|e| IpcError::messaging("receive on", NAME, e))?;
        Ok(received.map(|active| Asked { request: *active.payload(), active }))
    }

    /// Whether there are so many callers that some are probably dead; [`Bus::sweep_dead`] then makes room.
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
        self.active.send_copy(*reply).map_err(|e| IpcError::messaging("reply on", NAME, e))
    }
}

/// The side that asks.
pub struct Caller {
    client: Client<Transport, OperatorRequest, (), OperatorReply, ()>,
    bell: Bell,
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
            .request_response::<OperatorRequest, OperatorReply>()
            .open()
            .map_err(|e| IpcError::messaging("open service", NAME, e))?
            .client_builder()
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create()
            .map_err(|e| IpcError::messaging("ask on", NAME, e))?;
        Ok(Self { client, bell: bus.bell(topic::ASKED) })
    }

    /// Asks and waits for the reply; `None` if none came in time.
    ///
    /// # Errors
    /// [`IpcError::Messaging`] if iceoryx2 fails, [`IpcError::Message`] if the reply cannot be used.
    pub fn ask(&self, request: &OperatorRequest, patience: Duration) -> Result<Option<OperatorReply>, IpcError> {
        let pending = self.client.send_copy(*request).map_err(|e| IpcError::messaging("send on", NAME, e))?;
        // Whoever answers looks by itself, too; this only makes it sooner.
        self.bell.ring();
        let asked = Instant::now();
        loop {
            if let Some(response) = pending.receive().map_err(|e| IpcError::messaging("receive on", NAME, e))? {
                let reply = *response.payload();
                reply.check().map_err(|defect| IpcError::Message { topic: NAME, defect })?;
                return Ok(Some(reply));
            }
            if asked.elapsed() > patience {
                return Ok(None);
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }
}

/// For a program that only asks: iceoryx2 shall not tell its user about services that come and go.
pub fn quiet() {
    set_log_level(LogLevel::Fatal);
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::{any, prop_assert, proptest};

    #[test]
    fn what_is_asked_is_what_arrives() {
        let request = OperatorRequest::new(OperatorKind::Set, "stiffness.z=9000\0taper=0.1").unwrap();
        assert_eq!(request.parts(), Ok((OperatorKind::Set, "stiffness.z=9000\0taper=0.1")));
        assert!(OperatorRequest::new(OperatorKind::Set, &"x".repeat(REQUEST_TEXT)).is_ok());
        assert!(OperatorRequest::new(OperatorKind::Set, &"x".repeat(REQUEST_TEXT + 1)).is_err());
    }

    #[test]
    fn a_long_reply_is_cut_between_characters() {
        let reply = OperatorReply::new(ReplyCode::Done, &"é".repeat(REPLY_TEXT));
        assert_eq!(reply.check(), Ok(()));
        assert_eq!(reply.parts().unwrap().1.len(), REPLY_TEXT);
    }

    proptest! {
        #[test]
        fn garbage_is_refused_and_never_panics(
            kind in any::<u32>(),
            text_len in any::<u32>(),
            bytes in proptest::collection::vec(any::<u8>(), 64),
        ) {
            let mut text = [0xff; REQUEST_TEXT];
            text[..64].copy_from_slice(&bytes);
            let checked = OperatorRequest { kind, text_len, text }.check();
            if OperatorKind::from_code(kind).is_none() || text_len > 64 {
                prop_assert!(checked.is_err());
            }
        }
    }
}
