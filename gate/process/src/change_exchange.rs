//! Parameter changes for the gate, and the gate's replies.
//!
//! The supervisor writes a request into the page of changes and waits for the answer ([`ChangeClient`]). In the gate's
//! process a thread that is not real-time reads it and passes it on through a wait-free queue of bounded length; the gate
//! polls the queue once a tick ([`ChangeServer`]). The gate notes its decision in the page itself, so that a placed change
//! outlives it; the thread writes the answer.

use hapfic_config::{OperatorChange, ParameterSettings};
use hapfic_ipc::{CHANGES, ChangePage, Decision, IpcError};
use rtrb::{Consumer, Producer, RingBuffer};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Requests, or replies, in flight. One request is pending at a time; the others have been withdrawn.
const DEPTH: usize = 4;
/// Poll interval of the client for its reply, and of the thread for requests and replies.
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
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
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
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
    /// Set before the change; the client's is without the values of joint space, which no change concerns.
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

/// Content of a request in the page.
#[derive(Serialize, Deserialize)]
struct RequestText {
    made_on: Option<u64>,
    change: OperatorChange,
}

/// Side of the operator's server.
#[derive(Debug)]
pub struct ChangeClient {
    page: Arc<ChangePage>,
}

impl ChangeClient {
    /// Client of a run's page.
    #[must_use]
    pub fn new(page: Arc<ChangePage>) -> Self {
        Self { page }
    }

    /// Requests a change and waits for the reply.
    ///
    /// Returns `None` if the gate does not take the request within `timeout`; the request is then withdrawn. Also
    /// returns `None` if the gate takes it and does not reply within twice that time. If it has placed the change and was
    /// lost before the reply, `known` stands for the set before it.
    pub fn ask(
        &mut self,
        made_on: Option<u64>,
        change: &OperatorChange,
        known: &ParameterSettings,
        timeout: Duration,
    ) -> Option<ChangeReply> {
        let text = serde_json::to_string(&RequestText { made_on, change: *change }).ok()?;
        let id = self.page.open_request(&text);
        let begun = Instant::now();
        loop {
            if let Some(answer) = self.page.answer_to(id) {
                return serde_json::from_str(&answer).ok();
            }
            if begun.elapsed() > timeout && self.page.withdraw(id) {
                return None;
            }
            // The gate took it, and ended before the reply.
            if begun.elapsed() > 2 * timeout {
                let placed = self.page.decision(id).filter(|decision| decision.code == ChangeOutcome::Placed as u32)?;
                let Decision { effective_tick, version, taken_tick, .. } = placed;
                return Some(ChangeReply {
                    id,
                    outcome: ChangeOutcome::Placed,
                    version,
                    effective_tick,
                    taken_tick,
                    before: *known,
                });
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }
}

/// Side of the gate. No call waits or allocates.
#[derive(Debug)]
pub struct ChangeServer {
    requests: Consumer<ChangeRequest>,
    replies: Producer<ChangeReply>,
    /// Changes that the other gate has placed.
    placed: Consumer<OperatorChange>,
    /// Newest request that was left to the other gate.
    left: Option<ChangeRequest>,
    page: Arc<ChangePage>,
}

impl ChangeServer {
    /// Next change that the other gate has placed.
    pub fn next_placed(&mut self) -> Option<OperatorChange> {
        self.placed.pop().ok()
    }

    /// All changes that a gate has placed. The only call that allocates: for lockstep.
    #[must_use]
    pub fn all_placed(&self) -> Vec<OperatorChange> {
        placed(&self.page)
    }

    /// Leaves the pending request to the other gate, unless that ends before it takes it.
    pub fn leave(&mut self) {
        // Only the newest can be pending.
        while let Ok(request) = self.requests.pop() {
            self.left = Some(request);
        }
    }

    /// Whether a request may be pending.
    #[must_use]
    pub fn has_request(&self) -> bool {
        self.left.is_some() || !self.requests.is_empty()
    }

    /// Takes the pending request, if any. The caller replies immediately.
    pub fn take(&mut self) -> Option<ChangeRequest> {
        self.leave();
        self.left.take().filter(|request| self.page.take(request.id))
    }

    /// Sends a reply.
    pub fn reply(&mut self, reply: ChangeReply) {
        let ChangeReply { id, outcome, version, effective_tick, taken_tick, .. } = reply;
        self.page.decide(id, Decision { code: outcome as u32, effective_tick, version, taken_tick });
        // A full queue: the supervisor has stopped waiting for these replies.
        let _ = self.replies.push(reply);
    }
}

/// Changes that an earlier gate has placed, with their ticks.
#[must_use]
pub fn placed(page: &ChangePage) -> Vec<OperatorChange> {
    page.ids().filter_map(|id| placed_change(page, id)).collect()
}

/// A change with its tick, if a gate has placed it.
fn placed_change(page: &ChangePage, id: u64) -> Option<OperatorChange> {
    let decision = page.decision(id).filter(|decision| decision.code == ChangeOutcome::Placed as u32)?;
    let request: RequestText = serde_json::from_str(&page.request(id)?).ok()?;
    Some(OperatorChange { at_tick: decision.effective_tick, ..request.change })
}

/// Thread between the page and the queues of the gate; ends when dropped.
#[derive(Debug)]
pub struct ChangeThread {
    thread: Option<JoinHandle<()>>,
    end: Arc<AtomicBool>,
}

impl ChangeThread {
    /// Starts the thread. Requests that are in the page already are left to the gate before; what it places is taken.
    ///
    /// # Errors
    /// [`IpcError::System`] if the thread cannot be started.
    pub fn start(page: Arc<ChangePage>) -> Result<(Self, ChangeServer), IpcError> {
        let (mut request, requests) = RingBuffer::new(DEPTH);
        let (reply, mut replies) = RingBuffer::<ChangeReply>::new(DEPTH);
        let (mut place, placed) = RingBuffer::<OperatorChange>::new(CHANGES as usize);
        let server = ChangeServer { requests, replies: reply, placed, left: None, page: Arc::clone(&page) };
        let end = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&end);
        let mut seen = page.newest();
        let mut undecided: Vec<u64> = page.ids().collect();
        let serve = move || {
            while !ended.load(Ordering::Acquire) {
                // Only the newest can be pending.
                let newest = page.newest();
                if newest != seen {
                    undecided.extend(seen + 1..=newest);
                    seen = newest;
                    let text = page.request(newest).and_then(|text| serde_json::from_str::<RequestText>(&text).ok());
                    if let Some(RequestText { made_on, change }) = text {
                        // A full queue holds withdrawn requests: the gate takes none.
                        let _ = request.push(ChangeRequest { id: newest, made_on, change });
                    }
                }
                // Whichever gate has decided: both keep the placed changes.
                undecided.retain(|id| {
                    let Some(decision) = page.decision(*id) else { return *id + CHANGES > newest };
                    if let (true, Some(change)) = (decision.code == ChangeOutcome::Placed as u32, placed_change(&page, *id)) {
                        let _ = place.push(change);
                    }
                    false
                });
                while let Ok(reply) = replies.pop() {
                    if let Ok(text) = serde_json::to_string(&reply) {
                        page.answer(reply.id, &text);
                    }
                }
                std::thread::sleep(POLL_INTERVAL);
            }
        };
        let thread = std::thread::Builder::new()
            .name("hapfic-changes".to_owned())
            .spawn(serve)
            .map_err(|cause| IpcError::System { action: "start the thread of the operator's changes", cause })?;
        Ok((Self { thread: Some(thread), end }, server))
    }
}

impl Drop for ChangeThread {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            // Its panic has been printed.
            let _ = thread.join();
        }
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

    fn exchange() -> (ChangeClient, ChangeServer, ChangeThread) {
        let page = Arc::new(ChangePage::private().unwrap());
        let (thread, server) = ChangeThread::start(Arc::clone(&page)).unwrap();
        (ChangeClient::new(page), server, thread)
    }

    fn before() -> ParameterSettings {
        // What no change changes is not sent.
        ParameterSettings { joint_space: Default::default(), ..Settings::load("arm-press", &[]).unwrap().initial }
    }

    fn reply_to(request: &ChangeRequest, outcome: ChangeOutcome, version: u64) -> ChangeReply {
        ChangeReply::new(request, outcome, version, 7, 2, before())
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
        let (mut client, mut server, _thread) = exchange();
        for _ in 0..DEPTH + 3 {
            assert!(client.ask(None, &OperatorChange::default(), &before(), SHORT).is_none());
        }
        thread::sleep(SHORT);
        assert!(server.take().is_none(), "a withdrawn change never applies");
        // The queue is free again.
        let gate = thread::spawn(move || {
            let request = take(&mut server);
            server.reply(reply_to(&request, ChangeOutcome::Placed, 3));
            server
        });
        assert_eq!(client.ask(None, &OperatorChange::default(), &before(), LONG).map(|reply| reply.version), Some(3));
        drop(gate.join().unwrap());
    }

    #[test]
    fn ask_taken_request_gets_reply_with_every_bit() {
        let (mut client, mut server, _thread) = exchange();
        let change = OperatorChange {
            taper: Some(0.1 + 0.2),
            stiffness: Some([1e-300, 1.0 / 3.0, 4000.0]),
            saturation: Some(hapfic_config::Saturation::AsPrinted),
            ..OperatorChange::default()
        };
        let gate = thread::spawn(move || {
            let request = take(&mut server);
            assert_eq!((request.change, request.made_on), (change, Some(4)));
            server.reply(reply_to(&request, ChangeOutcome::Stale, 9));
        });
        let reply = client.ask(Some(4), &change, &before(), LONG).unwrap();
        assert_eq!((reply.outcome, reply.version, reply.before), (ChangeOutcome::Stale, 9, before()));
        gate.join().unwrap();
    }

    #[test]
    fn placed_changes_outlive_their_gate() {
        let (mut client, mut server, thread) = exchange();
        let page = Arc::clone(&client.page);
        let gate = thread::spawn(move || {
            for outcome in [ChangeOutcome::Placed, ChangeOutcome::Full, ChangeOutcome::Placed] {
                let request = take(&mut server);
                server.reply(reply_to(&request, outcome, 3));
            }
        });
        for taper in [0.1, 0.2, 0.3] {
            client.ask(None, &OperatorChange { taper: Some(taper), ..OperatorChange::default() }, &before(), LONG).unwrap();
        }
        gate.join().unwrap();
        drop(thread);
        let tapers: Vec<_> = placed(&page).iter().map(|change| (change.taper, change.at_tick)).collect();
        assert_eq!(tapers, [(Some(0.1), 7), (Some(0.3), 7)]);
    }
}
