//! The drain thread: receives all messages, sorts them by tick, and passes them to the writer.

use super::Record;
use hapfic_gate_process::shared_status::SharedStatus;
use hapfic_ipc::{Bus, Domain, Input, IpcError, Output, topic};
use hapfic_messages::{Check, Clock, Command, Credit, Event, Operator, Process, Reference, Request, State, Timing};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, SyncSender};
use std::time::Duration;

/// Interval at which shared memory is drained.
///
/// In lockstep the plant may wait for the drain. In realtime no process does, and each drain costs a wake-up and a poll
/// of all ports.
const fn drain_interval(clock: Clock) -> Duration {
    Duration::from_millis(match clock {
        Clock::Lockstep => 1,
        Clock::Realtime => 10,
    })
}

/// Ticks that a message may be ahead of the last command.
const AHEAD: i64 = 3;

/// Inputs of all topics, and the channel to the writer.
pub(super) struct Drain {
    clock: Clock,
    window: i64,
    shared: Arc<SharedStatus>,
    sender: SyncSender<Vec<Record>>,
    /// Batches to reuse: allocating each would cost more than draining.
    empties: Receiver<Vec<Record>>,
    /// Received messages, topic by topic, and their indices in the order of ticks.
    received: Vec<Option<Record>>,
    order: Vec<(i64, usize)>,
    state: Input<State>,
    reference: Input<Reference>,
    request: Input<Request>,
    command: Input<Command>,
    operator: Input<Operator>,
    event: Input<Event>,
    timing: Input<Timing>,
    credit: Output<Credit>,
    granted: i64,
    /// Newest tick of states, references and both controllers' requests.
    last: [i64; 4],
}

impl Drain {
    pub(super) fn open(
        domain: &Domain,
        clock: Clock,
        credit_ticks: u32,
        shared: Arc<SharedStatus>,
        sender: SyncSender<Vec<Record>>,
        empties: Receiver<Vec<Record>>,
    ) -> Result<Self, IpcError> {
        let bus = Bus::open(domain, "recorder")?;
        Ok(Self {
            clock,
            // Less than the buffers hold, so that none overflows in lockstep.
            window: i64::from(credit_ticks).min(topic::RECORDER_DEPTH as i64 / 4),
            shared,
            sender,
            empties,
            received: Vec::new(),
            order: Vec::new(),
            state: bus.recorder_input(&topic::STATE)?,
            reference: bus.recorder_input(&topic::REFERENCE)?,
            request: bus.recorder_input(&topic::REQUEST)?,
            command: bus.recorder_input(&topic::COMMAND)?,
            operator: bus.recorder_input(&topic::OPERATOR)?,
            event: bus.recorder_input(&topic::EVENT)?,
            timing: bus.recorder_input(&topic::TIMING)?,
            credit: bus.output(&topic::CREDIT)?,
            granted: -1,
            last: [-1; 4],
        })
    }

    pub(super) fn run(&mut self) -> Result<(), IpcError> {
        let mut newest = -1;
        loop {
            // Read before draining, so that all messages sent before the flag are received.
            let last = self.shared.drain.load(Ordering::Acquire);
            let batch = self.take_all()?;
            for record in &batch {
                match record {
                    Record::Timing(timing) => self.shared.record_heartbeat(timing),
                    Record::State(state) => newest = newest.max(state.tick),
                    _ => {}
                }
            }
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
            self.shared.recorder_failed_connections.store(failed_connections, Ordering::Relaxed);
            self.shared.listened();
            let empty = batch.is_empty();
            if !empty && self.sender.send(batch).is_err() {
                // The writer has failed, and reports that itself.
                return Ok(());
            }
            if last && empty {
                return Ok(());
            }
            if self.clock == Clock::Lockstep {
                // A plant that has just connected finds the credit in the history.
                self.credit.preloan();
            }
            if !last {
                // The recorder polls: a notification would cost every sender a system call per message.
                std::thread::sleep(drain_interval(self.clock));
            }
        }
    }
}

impl Drain {
    /// Receives all new messages; returns them in the order of ticks, causes first.
    fn take_all(&mut self) -> Result<Vec<Record>, IpcError> {
        let received = &mut self.received;
        received.clear();
        // Effects before their causes: the messages behind a command of this batch are then in it too, or in an earlier one.
        let mut ends = [0; 7];
        ends[0] = take(&mut self.timing, received, Record::Timing)?;
        ends[1] = take(&mut self.event, received, Record::Event)?;
        ends[2] = take(&mut self.command, received, Record::Command)?;
        ends[3] = take(&mut self.request, received, Record::Request)?;
        ends[4] = take(&mut self.reference, received, Record::Reference)?;
        ends[5] = take(&mut self.state, received, Record::State)?;
        ends[6] = take(&mut self.operator, received, Record::Operator)?;
        self.order.clear();
        for topic in (0..ends.len()).rev() {
            let begin = if topic == 0 { 0 } else { ends[topic - 1] };
            let ticked = |index: usize| received[index].as_ref().map(|record| (record.tick(), index));
            self.order.extend((begin..ends[topic]).filter_map(ticked));
        }
        // A stable sort keeps the order within a tick.
        self.order.sort_by_key(|(tick, _)| *tick);
        let mut batch = self.empties.try_recv().unwrap_or_default();
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
    fn is_new(&mut self, record: &Record) -> bool {
        let (last, tick) = match record {
            Record::State(m) => (&mut self.last[0], m.tick),
            Record::Reference(m) => (&mut self.last[1], m.tick),
            Record::Request(m) if m.controller == Process::Controller.code() => (&mut self.last[2], m.tick),
            Record::Request(m) => (&mut self.last[3], m.tick),
            _ => return true,
        };
        let new = tick > *last;
        // An implausibly late tick is recorded too, but does not hide later ones.
        if new && tick <= self.shared.gated.load(Ordering::Acquire) + AHEAD {
            *last = tick;
        }
        new
    }
}

/// Receives the new messages of a topic; returns the number of all received messages.
fn take<T>(input: &mut Input<T>, received: &mut Vec<Option<Record>>, wrap: fn(T) -> Record) -> Result<usize, IpcError>
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
