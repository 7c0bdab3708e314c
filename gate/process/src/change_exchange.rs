//! Changes of parameters on their way to the gate, and the gate's replies: two wait-free queues of bounded length.
//!
//! The client waits for a bounded time. A change that it has given up must not be made later: [`PendingId`] says whether the newest
//! request is still pending, so that either the gate takes it or the client withdraws it, never both.

use hapfic_config::{OperatorChange, Parameters};
use hapfic_sync::PendingId;
use rtrb::{Consumer, Producer, RingBuffer};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Requests, or replies, in flight. One request is pending at a time; the others have been withdrawn.
const DEPTH: usize = 4;
/// Interval at which the client looks for the reply.
const POLL_INTERVAL: Duration = Duration::from_micros(500);

/// A change that the gate is to make.
#[derive(Clone, Copy, Debug)]
pub struct ChangeRequest {
    id: u64,
    /// Version of the set that the change was made on; `None`: the change fits any.
    pub made_on: Option<u64>,
    /// The change; the gate chooses its tick.
    pub change: OperatorChange,
}

/// What the gate does with a change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChangeOutcome {
    /// It will take effect.
    Placed,
    /// It was made on another set than the one it would follow.
    Stale,
    /// The run ends before it could take effect.
    TooLate,
    /// Too many changes are waiting for their tick.
    Full,
}

/// The gate's reply.
#[derive(Clone, Copy, Debug)]
pub struct ChangeReply {
    id: u64,
    /// What becomes of the change.
    pub outcome: ChangeOutcome,
    /// Version that the set has, or would have.
    pub version: u64,
    /// First tick at which it is, or would be, in force.
    pub effective_tick: i64,
    /// Tick that was due when the gate took the request.
    pub taken_tick: i64,
    /// The set it follows.
    pub before: Parameters,
}

impl ChangeReply {
    /// The reply to a request.
    #[must_use]
    pub fn new(
        request: &ChangeRequest,
        outcome: ChangeOutcome,
        version: u64,
        effective_tick: i64,
        taken_tick: i64,
        before: Parameters,
    ) -> Self {
        Self { id: request.id, outcome, version, effective_tick, taken_tick, before }
    }
}

/// The side of the operator's server.
#[derive(Debug)]
pub struct ChangeClient {
    requests: Producer<ChangeRequest>,
    replies: Consumer<ChangeReply>,
    pending: Arc<PendingId>,
    last: u64,
}

/// The gate's side: nothing in it waits or allocates.
#[derive(Debug)]
pub struct ChangeServer {
    requests: Consumer<ChangeRequest>,
    replies: Producer<ChangeReply>,
    pending: Arc<PendingId>,
}

/// Both sides.
#[must_use]
pub fn exchange() -> (ChangeClient, ChangeServer) {
    let (request, requests) = RingBuffer::new(DEPTH);
    let (reply, replies) = RingBuffer::new(DEPTH);
    let pending = Arc::new(PendingId::default());
    let server = ChangeServer { requests, replies: reply, pending: Arc::clone(&pending) };
    (ChangeClient { requests: request, replies, pending, last: 0 }, server)
}

impl ChangeClient {
    /// Requests a change and waits for the reply. `None` if the gate did not take it within `timeout`: then it never will; or if the gate
    /// took it and has not replied within twice that time.
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
        let asked = Instant::now();
        loop {
            if let Ok(reply) = self.replies.pop()
                && reply.id == id
            {
                return Some(reply);
            }
            if asked.elapsed() > timeout && self.pending.withdraw(id) {
                return None;
            }
            // The gate has taken it, and ended before it could reply.
            if asked.elapsed() > 2 * timeout {
                return None;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }
}

impl ChangeServer {
    /// Takes the pending request, if there is one. To be replied to immediately.
    pub fn take(&mut self) -> Option<ChangeRequest> {
        while let Ok(request) = self.requests.pop() {
            if self.pending.take(request.id) {
                return Some(request);
            }
        }
        None
    }

    /// Replies.
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

    fn before() -> Parameters {
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
    fn ask_timed_out_request_is_withdrawn() {
        let (mut client, mut server) = exchange();
        assert!(client.ask(None, &OperatorChange::default(), SHORT).is_none());
        assert!(server.take().is_none(), "a withdrawn change is never made");
    }

    #[test]
    fn ask_full_queue_gives_up_and_recovers() {
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
    fn ask_after_a_timeout_gets_its_own_request_served() {
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
        assert_eq!(reply.version, 51, "the reply with the id of this request that came before it was asked is discarded");
        gate.join().unwrap();
    }

    #[test]
    fn ask_gate_that_took_it_and_ended_returns() {
        let (mut client, mut server) = exchange();
        let gate = thread::spawn(move || {
            let _ = take(&mut server);
        });
        let asked = Instant::now();
        assert!(client.ask(None, &OperatorChange::default(), Duration::from_millis(200)).is_none());
        assert!(asked.elapsed() < LONG);
        gate.join().unwrap();
    }
}
