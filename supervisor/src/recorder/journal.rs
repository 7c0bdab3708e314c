//! The journal: every message that is not flushed to the log yet, kept by the supervisor in lockstep.
//!
//! A thread of the supervisor receives the same messages as the recorder and forgets those that the recorder's page calls
//! flushed. The credit of the plant keeps their number small. When the inputs of a recorder are open, the first or a
//! successor, the thread writes the journal into the run's folder: what was sent before the inputs were open is in it, and
//! what was sent after is in the inputs. What is in both is dropped there.

use super::position::{identity, is_plausible, request_index};
use super::{RecordedMessage, replace};
use anyhow::{Context, Result, bail};
use hapfic_ipc::{Bus, Domain, Input, IpcError, LogPosition, RecorderPage, SharedStatus, topic};
use hapfic_messages::{Check, Command, Event, Message, Operator, Reference, Request, State, Timing};
use std::collections::{HashMap, VecDeque};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::thread::JoinHandle;
use std::time::Duration;

/// Interval at which the thread receives: the plant may wait for it.
const INTERVAL: Duration = Duration::from_millis(1);
/// Rounds for which a successor waits: a message whose sender was interrupted while it sent arrives in them.
const ROUNDS_BEFORE_HAND_OVER: u32 = 5;
/// Ticks after which an event is forgotten even if its identity was not found among the flushed ones.
const EVENT_TICKS: i64 = 4096;

/// The running thread; ends when dropped.
pub(super) struct JournalThread {
    thread: Option<JoinHandle<()>>,
    end: Arc<AtomicBool>,
}

impl JournalThread {
    /// Starts the thread; returns when its inputs are open. It must start before any process sends a message.
    pub(super) fn start(domain: &Domain, root: &Path, page: Arc<RecorderPage>, status: Arc<SharedStatus>) -> Result<Self> {
        let end = Arc::new(AtomicBool::new(false));
        let (domain, root, ended) = (domain.clone(), root.to_owned(), Arc::clone(&end));
        let (ready, opened) = channel();
        let thread = std::thread::Builder::new()
            .name("hapfic-journal".to_owned())
            .spawn(move || {
                let mut journal = match Journal::open(&domain, root, page, status) {
                    Ok(journal) => journal,
                    Err(e) => {
                        let _ = ready.send(Err(e));
                        return;
                    }
                };
                let _ = ready.send(Ok(()));
                while !ended.load(Ordering::Acquire) {
                    if let Err(e) = journal.round() {
                        crate::log_line(&format!("hapfic: the journal has failed, a lost recorder would lose messages: {e:#}"));
                        return;
                    }
                    std::thread::sleep(INTERVAL);
                }
            })
            .context("cannot start the journal")?;
        opened.recv().context("the journal ended immediately")??;
        Ok(Self { thread: Some(thread), end })
    }
}

impl Drop for JournalThread {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            // The thread logs its own errors.
            let _ = thread.join();
        }
    }
}

/// A topic and its messages that are not flushed.
struct Kept<T: Message> {
    input: Input<T>,
    messages: VecDeque<T>,
}

impl<T: Check + Message> Kept<T> {
    fn open(bus: &Bus, topic: &topic::Topic<T>) -> Result<Self, IpcError> {
        Ok(Self { input: bus.recorder_input(topic)?, messages: VecDeque::new() })
    }

    fn receive(&mut self) -> Result<(), IpcError> {
        while let Some(message) = self.input.next()? {
            if message.check().is_ok() {
                self.messages.push_back(message);
            }
        }
        Ok(())
    }

    /// Forgets messages from the oldest on.
    fn forget_while(&mut self, flushed: impl Fn(&T) -> bool) {
        while self.messages.front().is_some_and(&flushed) {
            self.messages.pop_front();
        }
    }
}

/// Journal of all topics.
struct Journal {
    state: Kept<State>,
    reference: Kept<Reference>,
    request: Kept<Request>,
    command: Kept<Command>,
    operator: Kept<Operator>,
    event: Kept<Event>,
    timing: Kept<Timing>,
    /// Number of events that were flushed and forgotten.
    events: u64,
    /// Identities of flushed events that have not come yet, with their number.
    early: HashMap<u64, u32>,
    /// Rounds for which a recorder has waited.
    waited: u32,
    status: Arc<SharedStatus>,
    page: Arc<RecorderPage>,
    root: PathBuf,
    _bus: Bus,
}

impl Journal {
    fn open(domain: &Domain, root: PathBuf, page: Arc<RecorderPage>, status: Arc<SharedStatus>) -> Result<Self, IpcError> {
        let bus = Bus::open(domain, "journal")?;
        Ok(Self {
            state: Kept::open(&bus, &topic::STATE)?,
            reference: Kept::open(&bus, &topic::REFERENCE)?,
            request: Kept::open(&bus, &topic::REQUEST)?,
            command: Kept::open(&bus, &topic::COMMAND)?,
            operator: Kept::open(&bus, &topic::OPERATOR)?,
            event: Kept::open(&bus, &topic::EVENT)?,
            timing: Kept::open(&bus, &topic::TIMING)?,
            events: 0,
            early: HashMap::new(),
            waited: 0,
            status,
            page,
            root,
            _bus: bus,
        })
    }

    fn round(&mut self) -> Result<()> {
        // Read before receiving: what it calls waiting has received nothing that is sent from now on and is not here.
        let waiting = self.page.waiting();
        self.receive()?;
        self.forget();
        self.waited = if waiting.is_some() { self.waited + 1 } else { 0 };
        if let Some(generation) = waiting
            && (generation == 0 || self.waited >= ROUNDS_BEFORE_HAND_OVER)
        {
            let content = self.content();
            replace(&path(&self.root, generation), &content).context("cannot hand the journal over")?;
            self.page.set_handed_over(generation);
        }
        if let Some(newest) = self.state.messages.back() {
            self.page.set_kept(newest.tick);
        }
        Ok(())
    }

    /// Receives, effects before their causes: a round then holds the messages that led to a command.
    fn receive(&mut self) -> Result<(), IpcError> {
        self.timing.receive()?;
        self.event.receive()?;
        self.command.receive()?;
        self.request.receive()?;
        self.reference.receive()?;
        self.state.receive()?;
        self.operator.receive()
    }

    /// Forgets what the recorder has flushed.
    fn forget(&mut self) {
        let flushed = self.page.flushed();
        let status = Arc::clone(&self.status);
        let done = |kind: usize, tick: i64| tick <= flushed.ticks[kind] || !is_plausible(tick, &status);
        self.state.forget_while(|m| done(0, m.tick));
        self.reference.forget_while(|m| done(1, m.tick));
        self.request.forget_while(|m| done(2 + request_index(m), m.tick));
        self.command.forget_while(|m| done(4, m.tick));
        // Each process has its own order.
        let timed = |m: &Timing| flushed.timing_ns.get(m.process as usize).is_some_and(|newest| m.wake_ns > *newest);
        self.timing.messages.retain(timed);
        // Every part of the log begins with the last two sets.
        while self.operator.messages.len() > 2
            && self.operator.messages.front().is_some_and(|sets| sets.next.effective_tick <= flushed.ticks[0])
        {
            self.operator.messages.pop_front();
        }
        self.forget_events(&flushed);
    }

    fn forget_events(&mut self, flushed: &LogPosition) {
        for identity in self.page.events(self.events, flushed.events) {
            *self.early.entry(identity).or_default() += 1;
        }
        self.events = self.events.max(flushed.events);
        let (early, newest) = (&mut self.early, flushed.ticks[0]);
        self.event.messages.retain(|event| {
            let flushed = !early.is_empty() && take(early, identity(event));
            !flushed && event.tick.saturating_add(EVENT_TICKS) >= newest
        });
    }

    fn content(&self) -> Vec<u8> {
        let mut content = Vec::new();
        put(&mut content, &self.operator.messages);
        put(&mut content, &self.state.messages);
        put(&mut content, &self.reference.messages);
        put(&mut content, &self.request.messages);
        put(&mut content, &self.command.messages);
        put(&mut content, &self.event.messages);
        put(&mut content, &self.timing.messages);
        content
    }
}

/// Takes one of the identities out of a set with repetitions; returns whether it was there.
pub(super) fn take(identities: &mut HashMap<u64, u32>, identity: u64) -> bool {
    let Some(count) = identities.get_mut(&identity) else { return false };
    *count -= 1;
    if *count == 0 {
        identities.remove(&identity);
    }
    true
}

/// Path of the journal that is handed over to a recorder.
fn path(root: &Path, generation: u32) -> PathBuf {
    root.join(format!("journal-{generation}"))
}

fn put<T: Message>(content: &mut Vec<u8>, messages: &VecDeque<T>) {
    content.extend_from_slice(&(messages.len() as u64).to_le_bytes());
    for message in messages {
        content.extend_from_slice(message.as_bytes());
    }
}

/// Reads the journal that was handed over to a recorder: all messages in the order of ticks, causes first.
pub(super) fn read(root: &Path, generation: u32) -> Result<Vec<RecordedMessage>> {
    let path = path(root, generation);
    let content = fs::read(&path).with_context(|| format!("cannot read the journal {}", path.display()))?;
    let _ = fs::remove_file(&path);
    let (mut rest, mut records) = (content.as_slice(), Vec::new());
    take_all(&mut rest, &mut records, RecordedMessage::Operator)?;
    take_all(&mut rest, &mut records, RecordedMessage::State)?;
    take_all(&mut rest, &mut records, RecordedMessage::Reference)?;
    take_all(&mut rest, &mut records, RecordedMessage::Request)?;
    take_all(&mut rest, &mut records, RecordedMessage::Command)?;
    take_all(&mut rest, &mut records, RecordedMessage::Event)?;
    take_all(&mut rest, &mut records, RecordedMessage::Timing)?;
    // A stable sort keeps the order within a tick.
    records.sort_by_key(RecordedMessage::tick);
    Ok(records)
}

fn take_all<T: Message>(rest: &mut &[u8], records: &mut Vec<RecordedMessage>, wrap: fn(T) -> RecordedMessage) -> Result<()> {
    let Some((count, after)) = rest.split_first_chunk::<8>() else { bail!("the journal is cut off") };
    *rest = after;
    for _ in 0..u64::from_le_bytes(*count) {
        let Ok((message, after)) = T::read_from_prefix(rest) else { bail!("the journal is cut off") };
        records.push(wrap(message));
        *rest = after;
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_messages::{Detector, EventKind, Process, Severity};

    fn state(tick: i64) -> State {
        State { tick, ..State::default() }
    }

    #[test]
    fn journal_read_back_is_in_order_of_ticks() {
        let folder = tempfile::tempdir().unwrap();
        let mut content = Vec::new();
        put::<Operator>(&mut content, &VecDeque::from([Operator::default()]));
        put(&mut content, &VecDeque::from([state(4), state(5)]));
        put::<Reference>(&mut content, &VecDeque::new());
        put::<Request>(&mut content, &VecDeque::new());
        put(&mut content, &VecDeque::from([Command { tick: 4, ..Command::default() }]));
        let event = Event::new(3, Process::Plant, EventKind::Note, Severity::Nominal, Detector::None, "x");
        put(&mut content, &VecDeque::from([event]));
        put::<Timing>(&mut content, &VecDeque::new());
        fs::write(path(folder.path(), 2), &content).unwrap();
        let records = read(folder.path(), 2).unwrap();
        let order: Vec<_> = records
            .iter()
            .map(|record| match record {
                RecordedMessage::Operator(_) => ("operator", 0),
                RecordedMessage::State(m) => ("state", m.tick),
                RecordedMessage::Command(m) => ("command", m.tick),
                RecordedMessage::Event(m) => ("event", m.tick),
                _ => ("other", 0),
            })
            .collect();
        assert_eq!(order, [("operator", 0), ("event", 3), ("state", 4), ("command", 4), ("state", 5)]);
        for length in [0, 7, content.len() - 9] {
            fs::write(path(folder.path(), 2), &content[..length]).unwrap();
            assert!(read(folder.path(), 2).is_err(), "{length}");
        }
        assert!(read(folder.path(), 3).is_err());
    }

    #[test]
    fn identities_are_taken_as_often_as_they_are_there() {
        let mut identities = HashMap::from([(7, 2)]);
        assert_eq!([7, 8, 7, 7].map(|identity| take(&mut identities, identity)), [true, false, true, false]);
        assert!(identities.is_empty());
    }
}
