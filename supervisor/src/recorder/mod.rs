//! The recorder: takes in every message of every tick, and writes them.
//!
//! Two threads, so that a disk that stalls does not stall the taking in: one drains shared memory every ten milliseconds, in
//! lockstep every millisecond (`drain.rs`), and passes what it found on; the other encodes, sums up and writes (`write.rs`). Neither is a
//! real-time thread.

mod drain;
mod incident;
mod viewer_frames;
mod write;

use anyhow::{Context, Result};
use drain::Drain;
use hapfic_gate_process::shared_status::SharedStatus;
use hapfic_ipc::{Domain, IpcError};
use hapfic_log::{LogError, Metrics, MetricsSummary, Viewer, Writer};
use hapfic_messages::{Clock, Command, Event, Operator, Process, Reference, Request, State, Timing};
use hapfic_robot::Chain;
use incident::Incidents;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{channel, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;
use viewer_frames::Shown;
use write::Write;

/// A message on its way to the file.
#[allow(clippy::large_enum_variant)] // A batch lives for milliseconds; a box for each message would cost more than the room.
enum Record {
    State(State),
    Reference(Reference),
    Request(Request),
    Command(Command),
    Operator(Operator),
    Event(Event),
    Timing(Timing),
}

/// Batches that may wait for the writer, in realtime ten milliseconds each, in lockstep up to a hundred ticks. A disk that stalls for longer
/// stalls the draining too; in lockstep the plant then waits for its credit, in realtime ticks are lost, and counted.
const QUEUE_REALTIME: usize = 512;
const QUEUE_LOCKSTEP: usize = 64;
/// Empty batches kept to be filled again.
const EMPTIES: usize = 4;

impl Record {
    /// The tick it belongs to; parameters come before everything they may govern.
    fn tick(&self) -> i64 {
        match self {
            Self::State(m) => m.tick,
            Self::Reference(m) => m.tick,
            Self::Request(m) => m.tick,
            Self::Command(m) => m.tick,
            Self::Operator(_) => i64::MIN,
            Self::Event(m) => m.tick,
            Self::Timing(m) => m.tick,
        }
    }
}

/// What a recorder starts with.
pub struct RecorderStart {
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
    /// Where the log is.
    pub log: PathBuf,
    /// Shared with the rest of the supervisor.
    pub shared: Arc<SharedStatus>,
}

/// What was recorded.
#[derive(Clone, Copy, Debug)]
pub struct Recorded {
    /// The figures of the run.
    pub metrics: MetricsSummary,
    /// Messages written.
    pub messages: u64,
    /// Whether any request was ever accepted.
    pub active: bool,
    /// Of them, states and commands.
    pub ticks: [u64; 2],
    /// Size of the file, bytes.
    pub file_bytes: u64,
}

/// What the writing half ends with: the file's size, the figures, the brakes and stops.
type Written = (Result<u64, LogError>, Recorded, Option<IncidentSummary>);

/// A running recorder.
pub struct Recorder {
    drain: JoinHandle<Result<(), IpcError>>,
    write: JoinHandle<Written>,
}

impl Recorder {
    /// Starts both threads; returns when the recorder is connected.
    ///
    /// # Errors
    /// If threads or ports cannot be had.
    pub fn start(start: RecorderStart) -> Result<Self> {
        let (sender, receiver) = sync_channel(if start.clock == Clock::Lockstep { QUEUE_LOCKSTEP } else { QUEUE_REALTIME });
        let (done_with, empties) = sync_channel(EMPTIES);
        let (ready, connected) = channel();
        let RecorderStart { domain, clock, credit_ticks, writer, viewer, chain, flush_every, log, shared } = start;
        let drain_live = Arc::clone(&shared);
        let drain = std::thread::Builder::new()
            .name("hapfic-recorder".to_owned())
            .spawn(move || {
                let opened = Drain::open(&domain, clock, credit_ticks, drain_live, sender, empties);
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
            .spawn(move || {
                Write {
                    writer,
                    viewer,
                    chain,
                    shared,
                    metrics: Metrics::new(),
                    shown: Shown::default(),
                    missed: 0,
                    braked: 0,
                    active: false,
                    timing_at: 0,
                    incidents: Incidents::new(&log, clock),
                }
                .run(&receiver, &done_with, flush_every)
            })
            .context("cannot start the recorder")?;
        connected.recv().context("the recorder ended at once")??;
        Ok(Self { drain, write })
    }

    /// Whether it has ended by itself, which only an error makes it do.
    #[must_use]
    pub fn failed(&self) -> bool {
        self.drain.is_finished() || self.write.is_finished()
    }

    /// Waits for the end; [`SharedStatus::drain`] asks for it. Returns what was recorded, the brakes and stops, and what went wrong, if
    /// anything did.
    #[must_use]
    pub fn finish(self) -> (Option<Recorded>, Option<IncidentSummary>, Option<String>) {
        let drained = match self.drain.join() {
            Ok(Ok(())) => None,
            Ok(Err(e)) => Some(e.to_string()),
            Err(_) => Some("the recorder's thread panicked".to_owned()),
        };
        match self.write.join() {
            Ok((Ok(file_bytes), recorded, incidents)) => (Some(Recorded { file_bytes, ..recorded }), incidents, drained),
            Ok((Err(e), recorded, incidents)) => (Some(recorded), incidents, Some(e.to_string())),
            Err(_) => (None, None, Some("the writer's thread panicked".to_owned())),
        }
    }
}

pub use incident::IncidentSummary;

/// The process whose heartbeats stand for the gate.
pub const GATE: Process = Process::Supervisor;
