//! The drain thread: receives all messages, sorts them by tick, and passes them to the writer.

use super::position::{has_gap, has_lag, identity, is_plausible, least_of_every_tick, ticked};
use super::views::Views;
use super::write::WriterOrder;
use super::{RecordedMessage, journal};
use hapfic_ipc::{Bus, Domain, Input, IpcError, Orphanhood, Output, Ownership, RecorderPage, SharedStatus, clock, topic};
use hapfic_messages::{Check, Clock, Command, Credit, Event, Operator, Phase, Process, Reference, Request, State, Timing};
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};

/// Interval at which shared memory is drained.
///
/// In lockstep the plant may wait for the drain. In realtime no process waits, and each drain costs a wake-up and a
/// poll of all ports.
const fn drain_interval(clock: Clock) -> Duration {
    Duration::from_millis(match clock {
        Clock::Lockstep => 1,
        Clock::Realtime => 10,
    })
}

/// Interval at which a full queue to the writer is looked at.
const WAIT_INTERVAL: Duration = Duration::from_millis(1);

/// Interval at which the journal is read while a topic lags behind the others.
const LAG_INTERVAL: Duration = Duration::from_millis(50);

/// Time that the last flush may take once the run has no supervisor any more.
const LAST_FLUSH: Duration = Duration::from_secs(1);

/// Arguments of [`DrainThread::open`].
pub(super) struct DrainStart<'a> {
    pub(super) domain: &'a Domain,
    pub(super) clock: Clock,
    pub(super) generation: u32,
    /// Ticks the plant may be ahead, in lockstep.
    pub(super) credit_ticks: u32,
    /// The supervisor of the run.
    pub(super) owner: Ownership,
    pub(super) page: Arc<RecorderPage>,
    pub(super) status: Arc<SharedStatus>,
    pub(super) sender: SyncSender<WriterOrder>,
    /// Batches to reuse: allocating each would cost more than draining.
    pub(super) empty_batches: Receiver<Vec<RecordedMessage>>,
}

/// Inputs of all topics, and the channel to the writer.
pub(super) struct DrainThread {
    clock: Clock,
    generation: u32,
    window: i64,
    owner: Ownership,
    page: Arc<RecorderPage>,
    status: Arc<SharedStatus>,
    sender: SyncSender<WriterOrder>,
    empty_batches: Receiver<Vec<RecordedMessage>>,
    /// Received messages, topic by topic, and their indices in the order of ticks.
    received: Vec<Option<RecordedMessage>>,
    order: Vec<(i64, usize)>,
    state: Input<State>,
    reference: Input<Reference>,
    request: Input<Request>,
    command: Input<Command>,
    operator: Input<Operator>,
    event: Input<Event>,
    timing: Input<Timing>,
    views: Views,
    credit: Output<Credit>,
    granted: i64,
    /// Newest state.
    newest: i64,
    /// Newest tick of states, references, both controllers' requests, and commands.
    last: [i64; 5],
    /// Whether the journal was read, and when last.
    has_read_journal: bool,
    journal_read: Instant,
    /// Newest wake-up in the timing of each process in the journal [ns].
    journal_timing_ns: [u64; Process::ALL.len()],
    /// Identities of the events in the journal, until the messages that may be in both are received.
    journal_events: HashMap<u64, u32>,
    bus: Bus,
}

impl DrainThread {
    /// Opens the ports. From then on the thread misses no message.
    pub(super) fn open(start: DrainStart<'_>) -> Result<Self, IpcError> {
        let DrainStart { domain, clock, generation, credit_ticks, owner, page, status, sender, empty_batches } = start;
        let bus = Bus::open(domain, "recorder")?;
        // A successor finds old messages in the histories. In lockstep the log knows which are new. In realtime the log may
        // hold more than was flushed, so all are left out.
        let last = match (generation, clock) {
            (0, _) => [-1, -1, -1, -1, -2],
            (_, Clock::Lockstep) => page.flushed().ticks,
            (_, Clock::Realtime) => [status.gate.tick.load(Ordering::Acquire); 5],
        };
        let drain = Self {
            clock,
            generation,
            // Less than the buffers hold, so that none overflows in lockstep.
            window: i64::from(credit_ticks).min(topic::RECORDER_DEPTH as i64 / 4),
            owner,
            sender,
            empty_batches,
            received: Vec::new(),
            order: Vec::new(),
            state: bus.recorder_input(&topic::STATE)?,
            reference: bus.recorder_input(&topic::REFERENCE)?,
            request: bus.recorder_input(&topic::REQUEST)?,
            command: bus.recorder_input(&topic::COMMAND)?,
            operator: bus.recorder_input(&topic::OPERATOR)?,
            event: bus.recorder_input(&topic::EVENT)?,
            timing: bus.recorder_input(&topic::TIMING)?,
            views: Views::open(&bus)?,
            credit: bus.output(&topic::CREDIT)?,
            granted: -1,
            // What the predecessors have flushed grants credit, too.
            newest: if generation == 0 { -1 } else { last[0] },
            last,
            has_read_journal: false,
            journal_read: Instant::now(),
            journal_timing_ns: [0; Process::ALL.len()],
            journal_events: HashMap::new(),
            page,
            status,
            bus,
        };
        drain.beat(Phase::Ready);
        Ok(drain)
    }

    /// Takes the messages that are not in the log, in lockstep: those that the predecessors have not written, and those of
    /// senders whose connections have failed. What the writer has is flushed.
    ///
    /// # Errors
    /// [`IpcError`] if the journal cannot be read.
    pub(super) fn take_journal(&mut self) -> Result<(), IpcError> {
        if self.clock == Clock::Realtime {
            return Ok(());
        }
        self.journal_read = Instant::now();
        let mut batch = journal::read(&self.bus, &self.page, &self.status)?;
        let first = !std::mem::replace(&mut self.has_read_journal, true);
        // A time of waking up tells heartbeats apart from those of before, but not from those that are on their way.
        batch.retain(|record| (first || !matches!(record, RecordedMessage::Timing(_))) && self.is_new(record));
        for record in &batch {
            match record {
                RecordedMessage::Event(m) => *self.journal_events.entry(identity(m)).or_default() += 1,
                RecordedMessage::Timing(m) => {
                    if let Some(newest) = self.journal_timing_ns.get_mut(m.process as usize) {
                        *newest = m.wake_ns.max(*newest);
                    }
                }
                RecordedMessage::State(m) => self.newest = self.newest.max(m.tick),
                _ => {}
            }
            self.views.publish(record);
        }
        if !batch.is_empty() {
            // The writer reports its own error.
            let _ = self.pass_on(batch);
        }
        Ok(())
    }

    /// Takes what is in the rings and neither in the log nor on its way to it.
    fn read_journal_again(&mut self) -> Result<(), IpcError> {
        // Otherwise nobody knows what is in the log.
        if self.flush() { self.take_journal() } else { Ok(()) }
    }

    /// Receives until the end is ordered, or the run has no supervisor any more, and nothing is left.
    ///
    /// # Errors
    /// [`IpcError`] if a connection is damaged.
    pub(super) fn run(&mut self) -> Result<(), IpcError> {
        let mut last_look = self.clock == Clock::Realtime;
        loop {
            // Read before draining, so that all messages sent before the order are received.
            let end = self.page.drain_ordered() || self.owner.look(clock::now_ns()) == Orphanhood::AllEnd;
            self.receive_all()?;
            let behind = self.is_behind();
            if behind {
                self.read_journal_again()?;
            }
            let batch = self.new_ones();
            if !behind {
                // What was sent before the journal was read has been received by now.
                self.journal_events.clear();
            }
            for record in &batch {
                self.views.publish(record);
                if let RecordedMessage::State(state) = record {
                    self.newest = self.newest.max(state.tick);
                }
            }
            self.grant()?;
            self.page.count_round();
            let empty = batch.is_empty();
            if !empty && !self.pass_on(batch) {
                // The writer has failed, and reports its own error.
                return Ok(());
            }
            if end && empty {
                if last_look {
                    return Ok(());
                }
                // Nobody sends any more, so nothing is both in the journal and on its way.
                last_look = true;
                self.read_journal_again()?;
            }
            self.beat(Phase::Running);
            if self.clock == Clock::Lockstep {
                // A plant that has just connected finds the credit in the history.
                self.credit.preloan();
            }
            if !end {
                // The recorder polls: a notification would cost every sender a system call per message.
                std::thread::sleep(drain_interval(self.clock));
            }
        }
    }

    /// Grants the plant the ticks that its recorders cannot miss.
    fn grant(&mut self) -> Result<(), IpcError> {
        if self.clock == Clock::Realtime {
            return Ok(());
        }
        // What is not flushed fits into the rings, whatever has not arrived of it.
        let flushed = least_of_every_tick(&self.page.flushed().ticks);
        let granted = (self.newest + self.window).min(flushed + topic::MAX_UNFLUSHED as i64);
        if granted > self.granted {
            self.granted = granted;
            self.credit.send(&Credit { tick: granted })?;
            self.credit.preloan();
        }
        Ok(())
    }

    /// Passes a batch to the writer, and waits for it as long as a disk stalls it; `false` if the writer has ended, or the run
    /// has no supervisor any more.
    fn pass_on(&mut self, batch: Vec<RecordedMessage>) -> bool {
        self.order_writer(WriterOrder::Write(batch))
    }

    /// Waits until all that was passed on is flushed; returns whether it is. A run without a supervisor does not wait long.
    fn flush(&mut self) -> bool {
        let (sender, answer) = sync_channel(1);
        if !self.order_writer(WriterOrder::Flush(sender)) {
            return false;
        }
        let begun = Instant::now();
        loop {
            match answer.recv_timeout(WAIT_INTERVAL) {
                Ok(()) => return true,
                Err(RecvTimeoutError::Disconnected) => return false,
                Err(RecvTimeoutError::Timeout) => self.beat(Phase::Waiting),
            }
            if self.owner.look(clock::now_ns()) == Orphanhood::AllEnd && begun.elapsed() > LAST_FLUSH {
                return false;
            }
        }
    }

    fn order_writer(&mut self, mut order: WriterOrder) -> bool {
        loop {
            match self.sender.try_send(order) {
                Ok(()) => return true,
                Err(TrySendError::Disconnected(_)) => return false,
                Err(TrySendError::Full(full)) => {
                    order = full;
                    if self.owner.look(clock::now_ns()) == Orphanhood::AllEnd {
                        return false;
                    }
                    self.beat(Phase::Waiting);
                    std::thread::sleep(WAIT_INTERVAL);
                }
            }
        }
    }

    /// Writes the heartbeat. The recorder receives timing messages and sends none.
    fn beat(&self, phase: Phase) {
        let now = clock::now_ns();
        let timing = Timing {
            process: Process::Recorder.code(),
            phase: phase.code(),
            tick: self.newest,
            due_ns: now,
            wake_ns: now,
            generation: self.generation,
            failed_connections: hapfic_ipc::failed_connections(),
            ..Timing::default()
        };
        self.status.heartbeats.write(&timing, now);
    }

    /// Receives all messages, and brings them into the order of ticks, causes first.
    fn receive_all(&mut self) -> Result<(), IpcError> {
        let received = &mut self.received;
        received.clear();
        // Effects before their causes: this batch or an earlier batch then holds the messages that led to a command.
        let mut ends = [0; 7];
        ends[0] = receive_new(&mut self.timing, received, RecordedMessage::Timing)?;
        ends[1] = receive_new(&mut self.event, received, RecordedMessage::Event)?;
        ends[2] = receive_new(&mut self.command, received, RecordedMessage::Command)?;
        ends[3] = receive_new(&mut self.request, received, RecordedMessage::Request)?;
        ends[4] = receive_new(&mut self.reference, received, RecordedMessage::Reference)?;
        ends[5] = receive_new(&mut self.state, received, RecordedMessage::State)?;
        ends[6] = receive_new(&mut self.operator, received, RecordedMessage::Operator)?;
        self.order.clear();
        for topic in (0..ends.len()).rev() {
            let begin = if topic == 0 { 0 } else { ends[topic - 1] };
            let ticked = |index: usize| received[index].as_ref().map(|record| (record.tick(), index));
            self.order.extend((begin..ends[topic]).filter_map(ticked));
        }
        // A stable sort keeps the order within a tick.
        self.order.sort_by_key(|(tick, _)| *tick);
        Ok(())
    }

    /// Whether messages are missing, in lockstep: a tick before a received one, or the last ones of a topic.
    fn is_behind(&self) -> bool {
        if self.clock == Clock::Realtime {
            return false;
        }
        let idle = self.order.is_empty();
        if has_lag(&self.last, idle) && self.journal_read.elapsed() >= LAG_INTERVAL {
            return true;
        }
        let received = self.order.iter().filter_map(|(_, index)| self.received[*index].as_ref().and_then(ticked));
        has_gap(self.last, received.filter(|(_, tick)| is_plausible(*tick, &self.status)))
    }

    /// The new ones of the received messages.
    fn new_ones(&mut self) -> Vec<RecordedMessage> {
        let mut batch = self.empty_batches.try_recv().unwrap_or_default();
        for i in 0..self.order.len() {
            if let Some(record) = self.received[self.order[i].1].take()
                && self.is_new(&record)
            {
                batch.push(record);
            }
        }
        batch
    }

    /// Whether a message is not recorded yet: the last messages of a lost process are republished, and those of the journal
    /// may also come from their senders.
    fn is_new(&mut self, record: &RecordedMessage) -> bool {
        if let Some((kind, tick)) = ticked(record) {
            let last = &mut self.last[kind];
            let new = tick > *last;
            // An implausibly late tick is recorded too, but does not hide later ones.
            if new && is_plausible(tick, &self.status) {
                *last = tick;
            }
            return new;
        }
        match record {
            RecordedMessage::Event(m) => self.journal_events.is_empty() || !journal::take(&mut self.journal_events, identity(m)),
            RecordedMessage::Timing(m) => {
                self.journal_timing_ns.get(m.process as usize).is_none_or(|newest| *newest == 0 || m.wake_ns > *newest)
            }
            _ => true,
        }
    }
}

/// Receives the new messages of a topic; returns the number of all received messages.
fn receive_new<T>(
    input: &mut Input<T>,
    received: &mut Vec<Option<RecordedMessage>>,
    wrap: fn(T) -> RecordedMessage,
) -> Result<usize, IpcError>
where
    T: Check + hapfic_messages::Message,
{
    while let Some(message) = input.next()? {
        if message.check().is_ok() {
            received.push(Some(wrap(message)));
        }
    }
    Ok(received.len())
}
