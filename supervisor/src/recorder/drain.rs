//! The draining half.

use super::Record;
use hapfic_gate_process::shared_status::SharedStatus;
use hapfic_ipc::{Bus, Domain, Input, IpcError, Output, topic};
use hapfic_messages::{Check, Clock, Command, Credit, Event, Operator, Process, Reference, Request, State, Timing};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, SyncSender};
use std::time::Duration;

/// How often shared memory is drained. In lockstep the plant may wait for it; in realtime nobody does, and each time costs a wake-up and
/// a look at all ports.
const fn drain_every(clock: Clock) -> Duration {
    Duration::from_millis(match clock {
        Clock::Lockstep => 1,
        Clock::Realtime => 10,
    })
}

/// How far ahead of the last command a message's tick may be.
const AHEAD: i64 = 3;

/// Everything that is sent, and where it goes.
pub(super) struct Drain {
    clock: Clock,
    window: i64,
    shared: Arc<SharedStatus>,
    sender: SyncSender<Vec<Record>>,
    /// What the writer has done with, to be filled again: fresh memory for each batch would be most of the work.
    empties: Receiver<Vec<Record>>,
    /// What has come, topic by topic, and its places in the order of ticks.
    come: Vec<Option<Record>>,
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
            // Less than the buffers hold, whatever the setting, so that nothing can overflow in lockstep.
            window: i64::from(credit_ticks).min(topic::RECORDER_DEPTH as i64 / 4),
            shared,
            sender,
            empties,
            come: Vec::new(),
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
            // Read before draining: what was sent before the flag was set is then taken in.
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
            self.shared.recorder_unmet.store(failed_connections, Ordering::Relaxed);
            self.shared.listened();
            let quiet = batch.is_empty();
            if !quiet && self.sender.send(batch).is_err() {
                // The writer has failed, and says so itself.
                return Ok(());
            }
            if last && quiet {
                return Ok(());
            }
            if self.clock == Clock::Lockstep {
                // A plant that has just joined finds the credit in the history.
                self.credit.preloan();
            }
            if !last {
                // Nobody wakes the recorder: that would cost every sender a system call a message.
                std::thread::sleep(drain_every(self.clock));
            }
        }
    }
}

impl Drain {
    /// Everything that has come, tick by tick, causes first.
    fn take_all(&mut self) -> Result<Vec<Record>, IpcError> {
        let come = &mut self.come;
        come.clear();
        // Effects before their causes: whatever a command in this batch came from is then in it too, or was before.
        let mut ends = [0; 7];
        ends[0] = take(&mut self.timing, come, Record::Timing)?;
        ends[1] = take(&mut self.event, come, Record::Event)?;
        ends[2] = take(&mut self.command, come, Record::Command)?;
        ends[3] = take(&mut self.request, come, Record::Request)?;
        ends[4] = take(&mut self.reference, come, Record::Reference)?;
        ends[5] = take(&mut self.state, come, Record::State)?;
        ends[6] = take(&mut self.operator, come, Record::Operator)?;
        self.order.clear();
        for topic in (0..ends.len()).rev() {
            let begin = if topic == 0 { 0 } else { ends[topic - 1] };
            let ticked = |place: usize| come[place].as_ref().map(|record| (record.tick(), place));
            self.order.extend((begin..ends[topic]).filter_map(ticked));
        }
        // Stable: within a tick as they are.
        self.order.sort_by_key(|(tick, _)| *tick);
        let mut batch = self.empties.try_recv().unwrap_or_default();
        for i in 0..self.order.len() {
            if let Some(record) = self.come[self.order[i].1].take()
                && self.is_new(&record)
            {
                batch.push(record);
            }
        }
        Ok(batch)
    }

    /// Whether a message has not been recorded yet: a successor says once more what its forerunner said last.
    fn is_new(&mut self, record: &Record) -> bool {
        let (last, tick) = match record {
            Record::State(m) => (&mut self.last[0], m.tick),
            Record::Reference(m) => (&mut self.last[1], m.tick),
            Record::Request(m) if m.controller == Process::Controller.code() => (&mut self.last[2], m.tick),
            Record::Request(m) => (&mut self.last[3], m.tick),
            _ => return true,
        };
        let new = tick > *last;
        // A tick that cannot be yet is recorded as it is, and does not keep out those that come.
        if new && tick <= self.shared.gated.load(Ordering::Acquire) + AHEAD {
            *last = tick;
        }
        new
    }
}

/// Takes what has come of a topic; returns how many there are in all.
fn take<T>(input: &mut Input<T>, come: &mut Vec<Option<Record>>, wrap: fn(T) -> Record) -> Result<usize, IpcError>
where
    T: Check + hapfic_messages::Message,
{
    while let Some(message) = input.next()? {
        if message.check().is_ok() {
            come.push(Some(wrap(message)));
        }
    }
    Ok(come.len())
}
