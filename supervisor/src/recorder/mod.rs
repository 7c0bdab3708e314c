//! The recorder: receives every message of every tick, and writes the log.
//!
//! It has two threads, so that a stalled disk does not stall receiving. The drain thread drains shared memory every
//! 10 ms, in lockstep every 1 ms (`drain.rs`). The writer thread encodes, computes the metrics and writes (`write.rs`).
//! Neither is a real-time thread.

mod disk;
mod drain;
mod incident;
mod latest;
mod viewer_frames;
mod views;
mod write;

use anyhow::{Context, Result};
use disk::Disk;
use drain::DrainThread;
use hapfic_gate_process::status::SharedStatus;
use hapfic_ipc::{Domain, IpcError};
use hapfic_log::{LogError, LogTotals, Metrics, MetricsSummary, Viewer, Writer};
use hapfic_messages::{Clock, Command, Event, Operator, Process, Reference, Request, State, Timing};
use hapfic_robot::Chain;
use hapfic_simulation::conditions::TaskFollower;
use incident::PostMortem;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{channel, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use viewer_frames::ViewerFrames;
use write::WriterThread;

/// Message in flight to the log.
#[allow(clippy::large_enum_variant)] // A batch lives for milliseconds; a box for each message would cost more than the memory.
enum RecordedMessage {
    State(State),
    Reference(Reference),
    Request(Request),
    Command(Command),
    Operator(Operator),
    Event(Event),
    Timing(Timing),
}

/// Batches in flight to the writer: in realtime of 10 ms each, in lockstep of up to 100 ticks.
///
/// A disk that stalls for longer stalls the draining too. In lockstep the plant then waits for its credit; in realtime
/// ticks are lost, and counted.
const QUEUE_REALTIME: usize = 512;
const QUEUE_LOCKSTEP: usize = 64;
/// Empty batches kept for reuse.
const EMPTY_BATCHES: usize = 4;

impl RecordedMessage {
    /// Returns the tick of the message; parameters come before all messages to which they may apply.
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

/// Arguments of [`Recorder::start`].
pub struct RecorderStart {
    /// Domain of the run.
    pub domain: Domain,
    /// Clock of the run.
    pub clock: Clock,
    /// Ticks the plant may be ahead, in lockstep.
    pub credit_ticks: u32,
    /// Writer of the open log.
    pub writer: Writer,
    /// Encoder of the viewer frames.
    pub viewer: Viewer,
    /// Kinematic chain, for the poses of the links.
    pub chain: Chain,
    /// Watch of the task's conditions.
    pub tasks: TaskFollower,
    /// Interval at which the file is flushed.
    pub flush_every: Duration,
    /// Free space of the disk below which the log ends [bytes].
    pub least_free: u64,
    /// Path of the log.
    pub log: PathBuf,
    /// Status shared with the other threads of the supervisor.
    pub shared: Arc<SharedStatus>,
    /// Latest messages, for the thread that answers operators.
    pub latest: Arc<LatestMessages>,
}

/// Result of the recording.
#[derive(Clone, Copy, Debug)]
pub struct RecordingResult {
    /// Metrics of the run.
    pub metrics: MetricsSummary,
    /// Messages written.
    pub messages: u64,
    /// Whether the gate ever accepted a request.
    pub active: bool,
    /// States and commands among the messages.
    pub ticks: [u64; 2],
    /// Size of all parts of the log [bytes].
    pub file_bytes: u64,
    /// Number of parts that were written, and of those that were removed again.
    pub parts: [u32; 2],
}

/// Result of the writer thread: totals of the log, metrics, brakes and stops.
type WriterResult = (Result<LogTotals, LogError>, RecordingResult, Option<IncidentSummary>);

/// A running recorder.
pub struct Recorder {
    drain: JoinHandle<Result<(), IpcError>>,
    write: JoinHandle<WriterResult>,
    latest: Arc<LatestMessages>,
    shared: Arc<SharedStatus>,
}

/// Time without a message written after which the end no longer waits for the recorder: a disk that hangs.
const GIVE_UP: Duration = Duration::from_secs(30);
/// Interval at which the end looks whether the recorder is done.
const FINISH_POLL: Duration = Duration::from_millis(2);

impl Recorder {
    /// Starts both threads; returns when the ports are open.
    ///
    /// # Errors
    /// If the threads cannot be started or the ports cannot be opened.
    pub fn start(start: RecorderStart) -> Result<Self> {
        let (sender, receiver) = sync_channel(if start.clock == Clock::Lockstep { QUEUE_LOCKSTEP } else { QUEUE_REALTIME });
        let (recycle, empty_batches) = sync_channel(EMPTY_BATCHES);
        let (ready, connected) = channel();
        let RecorderStart {
            domain,
            clock,
            credit_ticks,
            writer,
            viewer,
            chain,
            tasks,
            flush_every,
            least_free,
            log,
            shared,
            latest,
        } = start;
        let [drain_status, at_end] = [Arc::clone(&shared), Arc::clone(&shared)];
        let [latest_tasks, latest_at_end] = [Arc::clone(&latest), Arc::clone(&latest)];
        let drain = std::thread::Builder::new()
            .name("hapfic-recorder".to_owned())
            .spawn(move || {
                let opened = DrainThread::open(&domain, clock, credit_ticks, drain_status, latest, sender, empty_batches);
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
                WriterThread {
                    writer,
                    viewer,
                    chain,
                    tasks,
                    latest: latest_tasks,
                    shared,
                    metrics: Metrics::new(),
                    frames: ViewerFrames::default(),
                    active: false,
                    timing_log_ns: 0,
                    incidents: PostMortem::new(&log, clock),
                    disk: Disk::new(&log, least_free),
                }
                .run(&receiver, &recycle, flush_every)
            })
            .context("cannot start the recorder")?;
        connected.recv().context("the recorder ended immediately")??;
        Ok(Self { drain, write, latest: latest_at_end, shared: at_end })
    }

    /// Whether a thread of the recorder has ended early, which only an error causes.
    #[must_use]
    pub fn failed(&self) -> bool {
        self.drain.is_finished() || self.write.is_finished()
    }

    /// The latest messages, which outlive the recorder.
    #[must_use]
    pub fn latest(&self) -> Arc<LatestMessages> {
        Arc::clone(&self.latest)
    }

    /// Waits for both threads to end, which [`RunOrders::drain`](hapfic_gate_process::status::RunOrders::drain) requests;
    /// no longer than 30 s in which no message is written. The log then ends where the disk hung; `hapfic recover`
    /// reads it.
    ///
    /// Returns the result, the brakes and stops, and the first error.
    #[must_use]
    pub fn finish(self) -> (Option<RecordingResult>, Option<IncidentSummary>, Option<String>) {
        let written = || self.shared.recorder.written.load(Ordering::Relaxed);
        let (mut last, mut since) = (written(), Instant::now());
        while !(self.drain.is_finished() && self.write.is_finished()) {
            if last != written() {
                (last, since) = (written(), Instant::now());
            } else if since.elapsed() >= GIVE_UP {
                let what = format!("the log could not be finished: no message was written for {} s", GIVE_UP.as_secs());
                return (None, None, Some(what));
            }
            std::thread::sleep(FINISH_POLL);
        }
        let drained = match self.drain.join() {
            Ok(Ok(())) => None,
            Ok(Err(e)) => Some(e.to_string()),
            Err(_) => Some("the recorder's thread panicked".to_owned()),
        };
        match self.write.join() {
            Ok((Ok(totals), recorded, incidents)) => {
                let recorded = RecordingResult { file_bytes: totals.file_bytes, parts: totals.parts, ..recorded };
                (Some(recorded), incidents, drained)
            }
            Ok((Err(e), recorded, incidents)) => (Some(recorded), incidents, Some(e.to_string())),
            Err(_) => (None, None, Some("the writer's thread panicked".to_owned())),
        }
    }
}

pub(crate) use disk::free_bytes;
pub use incident::IncidentSummary;
pub use latest::LatestMessages;

/// The process under whose code the gate sends its heartbeats.
pub const GATE: Process = Process::Supervisor;
