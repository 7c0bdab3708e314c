//! The drain thread: receives all messages, sorts them by tick, and passes them to the writer.

use super::views::Views;
use super::{LatestMessages, RecordedMessage};
use hapfic_gate_process::status::SharedStatus;
use hapfic_ipc::{Bus, Domain, Input, IpcError, Output, topic};
use hapfic_messages::{Check, Clock, Command, Credit, Event, Operator, Process, Reference, Request, State, Timing};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, SyncSender};
use std::time::Duration;

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

/// Ticks that a message may be ahead of the last command.
const MAX_TICKS_AHEAD: i64 = 3;

/// Inputs of all topics, and the channel to the writer.
pub(super) struct DrainThread {
    clock: Clock,
    window: i64,
    shared: Arc<SharedStatus>,
    latest: Arc<LatestMessages>,
    sender: SyncSender<Vec<RecordedMessage>>,
    /// Batches to reuse: allocating each would cost more than draining.
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
    /// Newest tick of states, references and both controllers' requests.
    last: [i64; 4],
}

impl DrainThread {
    pub(super) fn open(
        domain: &Domain,
        clock: Clock,
        credit_ticks: u32,
        shared: Arc<SharedStatus>,
        latest: Arc<LatestMessages>,
        sender: SyncSender<Vec<RecordedMessage>>,
        empty_batches: Receiver<Vec<RecordedMessage>>,
    ) -> Result<Self, IpcError> {
        let bus = Bus::open(domain, "recorder")?;
        Ok(Self {
            clock,
            // Less than the buffers hold, so that none overflows in lockstep.
            window: i64::from(credit_ticks).min(topic::RECORDER_DEPTH as i64 / 4),
            shared,
            latest,
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
            last: [-1; 4],
        })
    }

    pub(super) fn run(&mut self) -> Result<(), IpcError> {
        let mut newest = -1;
        loop {
            // Read before draining, so that all messages sent before the flag are received.
            let end = self.shared.orders.drain.load(Ordering::Acquire);
            let batch = self.receive_all()?;
            for record in &batch {
                self.views.publish(record);
                match record {
                    RecordedMessage::Timing(timing) if timing.process == Process::Supervisor.code() && timing.latency_ns > 0 => {
                        self.shared.recorder.latencies.push(timing.latency_ns);
                    }
                    RecordedMessage::State(state) => newest = newest.max(state.tick),
                    _ => {}
                }
            }
            self.latest.update(&batch);
            if self.clock == Clock::Lockstep && newest + self.window > self.granted {
                self.granted = newest + self.window;
                self.credit.send(&Credit { tick: self.granted })?;
                self.credit.preloan();
            }
            let inputs = self.state.failed_connections()
                + self.reference.failed_connections()
                + self.request.failed_connections()
                + self.command.failed_connections();
            let failed_connections = inputs
                + self.operator.failed_connections()
                + self.event.failed_connections()
                + self.timing.failed_connections()
                + self.credit.failed_connections();
            self.shared.recorder.failed_connections.store(failed_connections, Ordering::Relaxed);
            self.shared.recorder.rounds.fetch_add(1, Ordering::Release);
            let empty = batch.is_empty();
            if !empty && self.sender.send(batch).is_err() {
                // The writer has failed, and reports its own error.
                return Ok(());
            }
            if end && empty {
                return Ok(());
            }
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
}

impl DrainThread {
    /// Receives all new messages; returns them in the order of ticks, causes first.
    fn receive_all(&mut self) -> Result<Vec<RecordedMessage>, IpcError> {
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
        let mut batch = self.empty_batches.try_recv().unwrap_or_default();
        for i in 0..self.order.len() {
            if let Some(record) = self.received[self.order[i].1].take()
                && self.is_new(&record)
            {
                batch.push(record);
            }
        }
        Ok(batch)
    }

    /// Whether a message is not recorded yet: the last messages of a lost process are republished.
    fn is_new(&mut self, record: &RecordedMessage) -> bool {
        let (last, tick) = match record {
            RecordedMessage::State(m) => (&mut self.last[0], m.tick),
            RecordedMessage::Reference(m) => (&mut self.last[1], m.tick),
            RecordedMessage::Request(m) if m.controller == Process::Controller.code() => (&mut self.last[2], m.tick),
            RecordedMessage::Request(m) => (&mut self.last[3], m.tick),
            _ => return true,
        };
        let new = tick > *last;
        // An implausibly late tick is recorded too, but does not hide later ones.
        if new && tick <= self.shared.gate.tick.load(Ordering::Acquire) + MAX_TICKS_AHEAD {
            *last = tick;
        }
        new
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
