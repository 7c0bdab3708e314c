//! Parameter changes for the gate, and the gate's replies: two wait-free queues of bounded length.
//!
//! The client waits for a bounded time, and the gate must not apply a change whose client has timed out. [`PendingId`]
//! marks the newest request as pending: either the gate takes it or the client withdraws it, never both.

use hapfic_config::{OperatorChange, ParameterSettings};
use hapfic_sync::PendingId;
use rtrb::{Consumer, Producer, RingBuffer};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Requests, or replies, in flight. One request is pending at a time; the others have been withdrawn.
const DEPTH: usize = 4;
/// Poll interval of the client for its reply.
const POLL_INTERVAL: Duration = Duration::from_micros(500);

/// Request for a change.
#[derive(Clone, Copy, Debug)]
pub struct ChangeRequest {
    id: u64,
    /// Version of the parameter set on which the change is based; `None`: any.
    pub made_on: Option<u64>,
    /// The change; the gate chooses its tick.
    pub change: OperatorChange,
}

/// Decision of the gate on a change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChangeOutcome {
    /// The change will take effect.
    Placed,
    /// The change is based on another set than the one it would follow.
    Stale,
    /// The run ends before the change could take effect.
    TooLate,
    /// Too many changes are waiting for their tick.
    Full,
}

/// Reply of the gate to a change.
#[derive(Clone, Copy, Debug)]
pub struct ChangeReply {
    id: u64,
    /// Decision on the change.
    pub outcome: ChangeOutcome,
    /// Version of the new set, even if the gate does not place it.
    pub version: u64,
    /// First tick of the new set, even if the gate does not place it.
    pub effective_tick: i64,
    /// Tick that was due when the gate took the request.
    pub taken_tick: i64,
    /// Set before the change.
    pub before: ParameterSettings,
}

impl ChangeReply {
    /// Reply to a request.
    #[must_use]
    pub fn new(
        request: &ChangeRequest,
        outcome: ChangeOutcome,
        version: u64,
        effective_tick: i64,
        taken_tick: i64,
        before: ParameterSettings,
    ) -> Self {
        Self { id: request.id, outcome, version, effective_tick, taken_tick, before }
    }
}

/// Side of the operator's server.
#[derive(Debug)]
pub struct ChangeClient {
    requests: Producer<ChangeRequest>,
    replies: Consumer<ChangeReply>,
    pending: Arc<PendingId>,
    last: u64,
}

/// Side of the gate. No call waits or allocates.
#[derive(Debug)]
pub struct ChangeServer {
    requests: Consumer<ChangeRequest>,
    replies: Producer<ChangeReply>,
    pending: Arc<PendingId>,
}

/// Both sides of a new exchange.
#[must_use]
pub fn exchange() -> (ChangeClient, ChangeServer) {
    let (request, requests) = RingBuffer::new(DEPTH);
    let (reply, replies) = RingBuffer::new(DEPTH);
    let pending = Arc::new(PendingId::default());
    let server = ChangeServer { requests, replies: reply, pending: Arc::clone(&pending) };
    (ChangeClient { requests: request, replies, pending, last: 0 }, server)
}

impl ChangeClient {
    /// Requests a change and waits for the reply.
    ///
    /// Returns `None` if the gate does not take the request within `timeout`; the request is then withdrawn. Also
    /// returns `None` if the gate takes it and does not reply within twice that time.
    pub fn ask(&mut self, made_on: Option<u64>, change: &OperatorChange, timeout: Duration) -> Option<ChangeReply> {
        self.last += 1;
        let id = self.last;
        // Replies that came too late.
        while self.replies.pop().is_ok() {}
        self.pending.open(id);
        if self.requests.push(ChangeRequest { id, made_on, change: *change }).is_err() {
            // The queue is full of withdrawn requests: the gate takes none.
            let _ = self.pending.withdraw(id);
            return None;
        }
        let begun = Instant::now();
        loop {
            if let Ok(reply) = self.replies.pop()
                && reply.id == id
            {
                return Some(reply);
            }
            if begun.elapsed() > timeout && self.pending.withdraw(id) {
                return None;
            }
            // The gate took it, and ended before the reply.
            if begun.elapsed() > 2 * timeout {
                return None;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }
}

impl ChangeServer {
    /// Takes the pending request, if any. The caller replies immediately.
    pub fn take(&mut self) -> Option<ChangeRequest> {
        while let Ok(request) = self.requests.pop() {
            if self.pending.take(request.id) {
                return Some(request);
            }
        }
        None
    }

    /// Sends a reply.
    pub fn reply(&mut self, reply: ChangeReply) {
        // A client that leaves its replies in the queue has stopped waiting for them.
        let _ = self.replies.push(reply);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_config::Settings;
    use std::thread;

    const SHORT: Duration = Duration::from_millis(5);
    const LONG: Duration = Duration::from_secs(20);

    fn before() -> ParameterSettings {
        Settings::load("floor", &[]).unwrap().initial
    }

    fn placed(request: &ChangeRequest, version: u64) -> ChangeReply {
        ChangeReply::new(request, ChangeOutcome::Placed, version, 7, 2, before())
    }

    /// Takes the next request, within a bounded time.
    fn take(server: &mut ChangeServer) -> ChangeRequest {
        let begun = Instant::now();
        loop {
            if let Some(request) = server.take() {
                return request;
            }
            assert!(begun.elapsed() < LONG, "no request is pending");
            thread::yield_now();
        }
    }

    #[test]
    fn ask_timed_out_request_withdrawn() {
        let (mut client, mut server) = exchange();
        assert!(client.ask(None, &OperatorChange::default(), SHORT).is_none());
        assert!(server.take().is_none(), "a withdrawn change never applies");
    }

    #[test]
    fn ask_full_queue_times_out_and_recovers() {
        let (mut client, mut server) = exchange();
        for _ in 0..10 * DEPTH {
            assert!(client.ask(None, &OperatorChange::default(), SHORT).is_none());
        }
        assert!(server.take().is_none());
        let gate = thread::spawn(move || {
            let request = take(&mut server);
            server.reply(placed(&request, 9));
        });
        assert_eq!(client.ask(None, &OperatorChange::default(), LONG).unwrap().version, 9);
        gate.join().unwrap();
    }

    #[test]
    fn ask_after_timeout_gets_own_reply() {
        let (mut client, mut server) = exchange();
        assert!(client.ask(Some(1), &OperatorChange::default(), SHORT).is_none());
        let gate = thread::spawn(move || {
            let request = take(&mut server);
            // Replies to other requests come first and last.
            server.reply(ChangeReply { id: request.id - 1, ..placed(&request, 0) });
            server.reply(placed(&request, request.made_on.unwrap() + 1));
            server.reply(ChangeReply { id: request.id + 1, ..placed(&request, 0) });
            server
        });
        let reply = client.ask(Some(41), &OperatorChange::default(), LONG).unwrap();
        assert_eq!((reply.outcome, reply.version), (ChangeOutcome::Placed, 42));
        let mut server = gate.join().unwrap();
        let gate = thread::spawn(move || {
            let request = take(&mut server);
            server.reply(placed(&request, request.made_on.unwrap() + 1));
        });
        let reply = client.ask(Some(50), &OperatorChange::default(), LONG).unwrap();
        assert_eq!(reply.version, 51, "an earlier reply with the id of this request is discarded");
        gate.join().unwrap();
    }

    #[test]
    fn ask_gate_ended_before_reply_returns() {
        let (mut client, mut server) = exchange();
        let gate = thread::spawn(move || {
            let _ = take(&mut server);
        });
        let begun = Instant::now();
        assert!(client.ask(None, &OperatorChange::default(), Duration::from_millis(200)).is_none());
        assert!(begun.elapsed() < LONG);
        gate.join().unwrap();
    }
}
