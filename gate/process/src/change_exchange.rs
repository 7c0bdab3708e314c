//! Changes on their way to the gate, and its replies: two wait-free queues of bounded length.
//!
//! Who asks waits only so long. A change that he has given up must not be made later, behind his back: one atomic number says
//! whether the newest change is still pending, so that either the gate takes it or it is withdrawn, never both.

use hapfic_config::{OperatorChange, Parameters};
use rtrb::{Consumer, Producer, RingBuffer};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Changes, or replies, under way. Only one is pending at a time; the others have been withdrawn.
const DEPTH: usize = 4;
/// How often the one who waits looks for the reply.
const POLL_INTERVAL: Duration = Duration::from_micros(500);

/// A change for the gate.
#[derive(Clone, Copy, Debug)]
pub struct ChangeRequest {
    id: u64,
    /// Version of the set the change was made on; `None`: it fits any.
    pub made_on: Option<u64>,
    /// The change; its tick is the gate's to choose.
    pub change: OperatorChange,
}

/// What the gate makes of a change.
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
    /// What became of it.
    pub outcome: ChangeOutcome,
    /// Version that the set has, or would have.
    pub version: u64,
    /// First tick at which it is, or would be, in force.
    pub effective_tick: i64,
    /// Tick that was due when the gate took it.
    pub taken_tick: i64,
    /// The set it follows.
    pub before: Parameters,
}

impl ChangeReply {
    /// The reply to an request.
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

/// The request with this id may be taken.
const fn pending(id: u64) -> u64 {
    2 * id
}

/// The request with this id may not be taken any more: the gate has it, or it was withdrawn.
const fn closed(id: u64) -> u64 {
    2 * id + 1
}

/// The side that requests.
#[derive(Debug)]
pub struct ChangeClient {
    requests: Producer<ChangeRequest>,
    replies: Consumer<ChangeReply>,
    state: Arc<AtomicU64>,
    last: u64,
}

/// The gate's side: nothing in it waits or allocates.
#[derive(Debug)]
pub struct ChangeServer {
    requests: Consumer<ChangeRequest>,
    replies: Producer<ChangeReply>,
    state: Arc<AtomicU64>,
}

/// Both sides.
#[must_use]
pub fn exchange() -> (ChangeClient, ChangeServer) {
    let (request, requests) = RingBuffer::new(DEPTH);
    let (reply, replies) = RingBuffer::new(DEPTH);
    let state = Arc::new(AtomicU64::new(closed(0)));
    let change_server = ChangeServer { requests, replies: reply, state: Arc::clone(&state) };
    (ChangeClient { requests: request, replies, state, last: 0 }, change_server)
}

impl ChangeClient {
    /// Offers a change and waits for the reply; `None` if the gate did not take it in time: then it never will.
    pub fn ask(&mut self, made_on: Option<u64>, change: &OperatorChange, patience: Duration) -> Option<ChangeReply> {
        self.last += 1;
        let id = self.last;
        // Answers that came too late.
        while self.replies.pop().is_ok() {}
        self.state.store(pending(id), Ordering::Release);
        // Full of withdrawn requests: the gate does not look.
        self.requests.push(ChangeRequest { id, made_on, change: *change }).ok()?;
        let asked = Instant::now();
        loop {
            if let Ok(reply) = self.replies.pop()
                && reply.id == id
            {
                return Some(reply);
            }
            if asked.elapsed() > patience && self.withdraw(id) {
                return None;
            }
            // The gate has it, and ended before it could reply.
            if asked.elapsed() > 2 * patience {
                return None;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }

    fn withdraw(&self, id: u64) -> bool {
        self.state.compare_exchange(pending(id), closed(id), Ordering::AcqRel, Ordering::Acquire).is_ok()
    }
}

impl ChangeServer {
    /// The change that is pending, if there is one. To be answered at once.
    pub fn take(&mut self) -> Option<ChangeRequest> {
        while let Ok(request) = self.requests.pop() {
            let taken =
                self.state.compare_exchange(pending(request.id), closed(request.id), Ordering::AcqRel, Ordering::Acquire).is_ok();
            if taken {
                return Some(request);
            }
        }
        None
    }

    /// Says what became of it.
    pub fn reply(&mut self, reply: ChangeReply) {
        // Whoever does not take his replies has stopped waiting for them.
        let _ = self.replies.push(reply);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_config::Settings;

    const SHORT: Duration = Duration::from_millis(5);
    const LONG: Duration = Duration::from_secs(20);

    fn reply(request: &ChangeRequest, before: Parameters) -> ChangeReply {
        ChangeReply::new(request, ChangeOutcome::Placed, 2, 7, 2, before)
    }

    #[test]
    fn what_was_given_up_is_never_taken() {
        let (mut change_client, mut change_server) = exchange();
        let change = OperatorChange::default();
        for _ in 0..10 * DEPTH {
            assert!(change_client.ask(None, &change, SHORT).is_none());
        }
        assert!(change_server.take().is_none());
    }

    #[test]
    fn an_answer_belongs_to_its_offer() {
        let before = Settings::load("floor", &[]).unwrap().initial;
        let (mut change_client, mut change_server) = exchange();
        assert!(change_client.ask(None, &OperatorChange::default(), SHORT).is_none());
        let gate = std::thread::spawn(move || {
            loop {
                if let Some(request) = change_server.take() {
                    // One that nobody waits for comes first.
                    change_server.reply(ChangeReply { id: request.id - 1, ..reply(&request, before) });
                    change_server.reply(ChangeReply { version: request.made_on.unwrap() + 1, ..reply(&request, before) });
                    return;
                }
                std::thread::yield_now();
            }
        });
        let reply = change_client.ask(Some(41), &OperatorChange::default(), LONG).unwrap();
        assert_eq!((reply.outcome, reply.version), (ChangeOutcome::Placed, 42));
        gate.join().unwrap();
    }
}
