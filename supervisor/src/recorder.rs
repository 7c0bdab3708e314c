//! The recorder: takes in every message of every tick, and writes them.
//!
//! Two threads, so that a disk that stalls does not stall the taking in: one drains shared memory every millisecond or two and
//! passes what it found on; the other encodes, sums up and writes. Neither is a real-time thread.

use crate::live::{Glance, Live};
use crate::scene;
use anyhow::{Context, Result};
use hapfic_ipc::message::{
    Command, Credit, Event, Operator, Parameters, Process, Reference, Request, State, Timing,
};
use hapfic_ipc::{Bus, Check, Clock, Domain, Input, IpcError, Output, topic};
use hapfic_log::{LogError, Metrics, MetricsSummary, Topic, Viewer, Writer, proto};
use hapfic_robot::Chain;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How often shared memory is drained.
const DRAIN_EVERY: Duration = Duration::from_millis(1);

/// A message on its way to the file.
enum Record {
    State(State),
    Reference(Reference),
    Request(Request),
    Command(Command),
    Operator(Operator),
    Event(Event),
    Timing(Timing),
}

/// What a recorder starts with.
pub struct Start {
    /// The run's domain.
    pub domain: Domain,
    /// How time passes.
    pub clock: Clock,
    /// Ticks the plant may be ahead, in lockstep.
    pub credit_ticks: u32,
    /// The open log.
    pub writer: Writer,
    /// What viewers get.
    pub viewer: Viewer,
    /// For the poses of the links.
    pub chain: Chain,
    /// How often the file is flushed.
    pub flush_every: Duration,
    /// Shared with the rest of the supervisor.
    pub live: Arc<Live>,
}

/// What was recorded.
#[derive(Clone, Copy, Debug)]
pub struct Recorded {
    /// The figures of the run.
    pub metrics: MetricsSummary,
    /// Messages written.
    pub messages: u64,
    /// Of them, states and commands.
    pub ticks: [u64; 2],
    /// Size of the file, bytes.
    pub file_bytes: u64,
}

/// A running recorder.
pub struct Recorder {
    drain: JoinHandle<Result<(), IpcError>>,
    write: JoinHandle<(Result<u64, LogError>, Recorded)>,
}

impl Recorder {
    /// Starts both threads; returns when the recorder is connected.
    ///
    /// # Errors
    /// If threads or ports cannot be had.
    pub fn start(start: Start) -> Result<Self> {
        let (sender, receiver) = channel();
        let (ready, connected) = channel();
        let Start { domain, clock, credit_ticks, writer, viewer, chain, flush_every, live } = start;
        let drain_live = Arc::clone(&live);
        let drain = std::thread::Builder::new()
            .name("hapfic-recorder".to_owned())
            .spawn(move || {
                let opened = Drain::open(&domain, clock, credit_ticks, drain_live, sender);
                match opened {
                    Ok(mut drain) => {
                        let _ = ready.send(Ok(()));
                        drain.run()
                    }
                    Err(e) => {
                        let _ = ready.send(Err(e));
                        Ok(())
                    }
                }
            })
            .context("cannot start the recorder")?;
        let write = std::thread::Builder::new()
            .name("hapfic-writer".to_owned())
            .spawn(move || Write { writer, viewer, chain, live, metrics: Metrics::new(), latest: Latest::default() }.run(&receiver, flush_every))
            .context("cannot start the recorder")?;
        connected.recv().context("the recorder ended at once")??;
        Ok(Self { drain, write })
    }

    /// Whether it has ended by itself, which only an error makes it do.
    #[must_use]
    pub fn failed(&self) -> bool {
        self.drain.is_finished() || self.write.is_finished()
    }

    /// Waits for the end; [`Live::drain`] asks for it. Returns what was recorded, and what went wrong, if anything did.
    #[must_use]
    pub fn finish(self) -> (Option<Recorded>, Option<String>) {
        let drained = match self.drain.join() {
            Ok(Ok(())) => None,
            Ok(Err(e)) => Some(e.to_string()),
            Err(_) => Some("the recorder's thread panicked".to_owned()),
        };
        match self.write.join() {
            Ok((Ok(file_bytes), recorded)) => (Some(Recorded { file_bytes, ..recorded }), drained),
            Ok((Err(e), recorded)) => (Some(recorded), Some(e.to_string())),
            Err(_) => (None, Some("the writer's thread panicked".to_owned())),
        }
    }
}

/// The draining half.
struct Drain {
    clock: Clock,
    window: i64,
    live: Arc<Live>,
    sender: Sender<Vec<Record>>,
    state: Input<State>,
    reference: Input<Reference>,
    request: Input<Request>,
    command: Input<Command>,
    operator: Input<Operator>,
    event: Input<Event>,
    timing: Input<Timing>,
    credit: Output<Credit>,
    granted: i64,
}

impl Drain {
    fn open(
        domain: &Domain,
        clock: Clock,
        credit_ticks: u32,
        live: Arc<Live>,
        sender: Sender<Vec<Record>>,
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
        })
    }

    fn run(&mut self) -> Result<(), IpcError> {
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
                std::thread::sleep(DRAIN_EVERY);
            }
        }
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

/// What viewers are shown is put together when a tick's command has come: everything else of the tick has then, too.
#[derive(Default)]
struct Latest {
    states: VecDeque<(State, proto::State)>,
    references: VecDeque<Reference>,
    operators: VecDeque<Parameters>,
    missed: u64,
    active: bool,
}

/// Ticks that may be waiting for their command at once, and parameter sets that may be in force among them.
const WAITING: usize = 2 * topic::RECORDER_DEPTH;

fn keep<T>(queue: &mut VecDeque<T>, value: T) {
    if queue.len() == WAITING {
        queue.pop_front();
    }
    queue.push_back(value);
}

impl Latest {
    /// State and reference of a tick, and the parameters in force at it; forgets what is older.
    fn of(&mut self, tick: i64) -> Option<(State, proto::State, Option<[f64; 3]>, Option<Parameters>)> {
        while self.states.front().is_some_and(|(s, _)| s.tick < tick) {
            self.states.pop_front();
        }
        while self.references.front().is_some_and(|r| r.tick < tick) {
            self.references.pop_front();
        }
        // The last one in force stays.
        while self.operators.get(1).is_some_and(|p| p.effective_tick <= tick) {
            self.operators.pop_front();
        }
        let (state, logged) = self.states.pop_front_if(|(s, _)| s.tick == tick)?;
        let reference = self.references.front().filter(|r| r.tick == tick).map(|r| r.position);
        Some((state, logged, reference, self.operators.front().copied()))
    }
}

/// The writing half.
struct Write {
    writer: Writer,
    viewer: Viewer,
    chain: Chain,
    live: Arc<Live>,
    metrics: Metrics,
    latest: Latest,
}

impl Write {
    fn run(mut self, receiver: &Receiver<Vec<Record>>, flush_every: Duration) -> (Result<u64, LogError>, Recorded) {
        let mut failed = None;
        let mut flushed = Instant::now();
        loop {
            match receiver.recv_timeout(flush_every) {
                // After an error the figures go on; only the file does not.
                Ok(batch) => {
                    for record in &batch {
                        let written = self.record(record, failed.is_none());
                        failed = failed.or(written.err());
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if failed.is_none() && flushed.elapsed() >= flush_every {
                failed = self.writer.flush().err();
                flushed = Instant::now();
            }
            if failed.is_some() {
                self.live.log_failed.store(true, Ordering::Release);
            }
        }
        let recorded = Recorded {
            metrics: self.metrics.summary(),
            messages: Topic::ALL.iter().map(|t| self.writer.messages(*t)).sum(),
            ticks: [self.writer.messages(Topic::State), self.writer.messages(Topic::Command)],
            file_bytes: 0,
        };
        let finished = match failed {
            Some(e) => Err(e),
            None => self.writer.finish().map(|totals| totals.file_bytes),
        };
        (finished, recorded)
    }

    fn record(&mut self, record: &Record, write: bool) -> Result<(), LogError> {
        match record {
            Record::State(m) => {
                let state = if write { self.writer.state(m)? } else { hapfic_log::convert::state(m, self.writer.names()) };
                self.metrics.push_state(&state);
                if self.viewer.due(m.tick) {
                    keep(&mut self.latest.states, (*m, state));
                }
            }
            Record::Reference(m) => {
                let reference = if write { self.writer.reference(m)? } else { hapfic_log::convert::reference(m) };
                self.metrics.push_reference(&reference);
                if self.viewer.due(m.tick) {
                    keep(&mut self.latest.references, *m);
                }
            }
            Record::Request(m) => {
                if write {
                    self.writer.request(m)?;
                }
            }
            Record::Command(m) => {
                // The command before the first tick only starts things.
                if m.tick < 0 {
                    return Ok(());
                }
                let command = if write { self.writer.command(m)? } else { hapfic_log::convert::command(m) };
                self.metrics.push_command(&command);
                self.latest.active |= m.mode == hapfic_ipc::message::Mode::Active.code();
                self.latest.missed += u64::from(self.latest.active && m.source != hapfic_ipc::message::Source::Fresh.code());
                if self.viewer.due(m.tick) {
                    self.show(m.tick, write)?;
                }
            }
            Record::Operator(m) => self.operator(m, write)?,
            Record::Event(m) => {
                let event = if write { self.writer.event(m)? } else { hapfic_log::convert::event(m) };
                if write {
                    let line = self.viewer.log_line(&event);
                    self.writer.log(m.tick.max(0), &line)?;
                }
            }
            Record::Timing(m) => {
                let at = self.writer.time_of(m.tick.max(0));
                let timing = if write { self.writer.timing(m, at)? } else { hapfic_log::convert::timing(m) };
                // A heartbeat in between is no tick's account.
                if m.publish_ns > 0 {
                    self.metrics.push_timing(&timing);
                }
            }
        }
        Ok(())
    }

    /// Each set is logged once, when it is announced.
    fn operator(&mut self, m: &Operator, write: bool) -> Result<(), LogError> {
        for set in [&m.current, &m.next] {
            if self.latest.operators.back().is_none_or(|last| set.version > last.version) {
                keep(&mut self.latest.operators, *set);
                let operator = if write { self.writer.operator(set)? } else { hapfic_log::convert::operator(set) };
                self.metrics.push_operator(&operator);
            }
        }
        Ok(())
    }

    fn show(&mut self, tick: i64, write: bool) -> Result<(), LogError> {
        let Some((m, state, reference, parameters)) = self.latest.of(tick) else { return Ok(()) };
        if write {
            let transforms = self.viewer.transforms(tick, &scene::poses(&self.chain, &m));
            self.writer.transforms(tick, &transforms)?;
            let target = parameters.map(|p| p.target_position);
            let update = self.viewer.scene_update(tick, &state.contacts, reference, target);
            self.writer.scene(tick, &update)?;
        }
        if let Ok(mut glance) = self.live.glance.lock() {
            *glance = Glance {
                time_s: m.time_ns as f64 * 1e-9,
                foot_position: m.foot_position,
                foot_force: m.foot_force,
                desired_force: parameters.map_or([0.0; 3], |p| p.desired_force),
                missed: self.latest.missed,
                late: m.slipped,
            };
        }
        Ok(())
    }
}

/// The process whose heartbeats stand for the gate.
pub const GATE: Process = Process::Supervisor;
