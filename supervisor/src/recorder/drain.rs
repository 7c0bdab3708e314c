//! The draining half.

use super::Record;
use crate::live::Live;
use hapfic_ipc::message::{Command, Credit, Event, Operator, Process, Reference, Request, State, Timing};
use hapfic_ipc::{Bus, Check, Clock, Domain, Input, IpcError, Output, topic};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::SyncSender;
use std::time::Duration;

/// How often shared memory is drained.
const DRAIN_EVERY: Duration = Duration::from_millis(1);

/// How far ahead of the last command a message's tick may be.
const AHEAD: i64 = 3;

/// Everything that is sent, and where it goes.
pub(super) struct Drain {
    clock: Clock,
    window: i64,
    live: Arc<Live>,
    sender: SyncSender<Vec<Record>>,
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
        live: Arc<Live>,
        sender: SyncSender<Vec<Record>>,
    ) -> Result<Self, IpcError> {
        let bus = Bus::open(domain, "recorder")?;
        Ok(Self {
            clock,
            // Less than the buffers hold, whatever the setting, so that nothing can overflow in lockstep.
            window: i64::from(credit_ticks).min(topic::RECORDER_DEPTH as i64 / 4),
            live,
            sender,
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
            let last = self.live.drain.load(Ordering::Acquire);
            let mut batch = Vec::new();
            // Effects before their causes: whatever a command in this batch came from is then in it too, or was before.
            take(&mut self.timing, &mut batch, Record::Timing)?;
            take(&mut self.event, &mut batch, Record::Event)?;
            take(&mut self.command, &mut batch, Record::Command)?;
            take(&mut self.request, &mut batch, Record::Request)?;
            take(&mut self.reference, &mut batch, Record::Reference)?;
            take(&mut self.state, &mut batch, Record::State)?;
            take(&mut self.operator, &mut batch, Record::Operator)?;
            batch.reverse();
            // Tick by tick, causes first.
            batch.sort_by_key(Record::tick);
            batch.retain(|record| self.is_new(record));
            for record in &batch {
                match record {
                    Record::Timing(timing) => self.live.hear(timing),
                    Record::State(state) => newest = newest.max(state.tick),
                    _ => {}
                }
            }
            if self.clock == Clock::Lockstep && newest + self.window > self.granted {
                self.granted = newest + self.window;
                self.credit.send(&Credit { tick: self.granted })?;
                self.credit.prepare();
            }
            let inputs = self.state.unmet() + self.reference.unmet() + self.request.unmet() + self.command.unmet();
            let unmet = inputs + self.operator.unmet() + self.event.unmet() + self.timing.unmet() + self.credit.unmet();
            self.live.recorder_unmet.store(unmet, Ordering::Relaxed);
            self.live.listened();
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
                self.credit.prepare();
            }
            if !last {
                // Nobody wakes the recorder: that would cost every sender a system call a message.
                std::thread::sleep(DRAIN_EVERY);
            }
        }
    }
}

impl Drain {
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
        if new && tick <= self.live.gated.load(Ordering::Acquire) + AHEAD {
            *last = tick;
        }
        new
    }
}

fn take<T>(input: &mut Input<T>, batch: &mut Vec<Record>, wrap: fn(T) -> Record) -> Result<(), IpcError>
where
    T: Check + Copy + std::fmt::Debug + hapfic_ipc::ZeroCopySend + 'static,
{
    let first = batch.len();
    while let Some(message) = input.next()? {
        if message.check().is_ok() {
            batch.push(wrap(message));
        }
    }
    // The whole batch is turned round before it is passed on: causes first, each topic in its order.
    batch[first..].reverse();
    Ok(())
}
