//! The writer thread: encodes and writes messages, computes the metrics, and keeps the post-mortem.

use super::disk::Disk;
use super::incident::PostMortem;
use super::position::{advance, identity};
use super::viewer_frames::ViewerFrames;
use super::{RecordedMessage, RecordingOutcome, replace, tasks_file};
use hapfic_ipc::{LogPosition, RecorderPage, SharedStatus};
use hapfic_log::{LogError, LogFigures, Metrics, Topic, Viewer, Writer, scene};
use hapfic_messages::{Event, Mode, Operator};
use hapfic_robot::Chain;
use hapfic_simulation::conditions::{TaskFollower, TaskReport};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::time::{Duration, Instant};

/// Interval at which the conditions of the task are written for the supervisor.
const TASKS_INTERVAL: Duration = Duration::from_millis(100);
/// Ticks after which the log is flushed in any case: in lockstep the plant waits for it.
const MAX_UNFLUSHED: i64 = 512;

/// What the writer gets.
pub(super) enum WriterOrder {
    /// Messages to write.
    Write(Vec<RecordedMessage>),
    /// To flush what is written, and to answer.
    Flush(SyncSender<()>),
}

/// Writer of the log, with the metrics and the viewer frames of the run.
pub(super) struct WriterThread {
    pub(super) writer: Writer,
    pub(super) viewer: Viewer,
    pub(super) chain: Chain,
    pub(super) tasks: TaskFollower,
    pub(super) page: Arc<RecorderPage>,
    pub(super) status: Arc<SharedStatus>,
    /// The run's folder.
    pub(super) root: PathBuf,
    pub(super) metrics: Metrics,
    pub(super) frames: ViewerFrames,
    pub(super) active: bool,
    pub(super) timing_log_ns: u64,
    pub(super) incidents: PostMortem,
    pub(super) disk: Disk,
    /// What is written, and what of it is flushed.
    pub(super) position: LogPosition,
    pub(super) flushed: LogPosition,
    /// Time of the last flush.
    pub(super) flushed_at: Instant,
    /// Conditions of the task that are written for the supervisor, and the time at which they were.
    pub(super) told: (Vec<TaskReport>, Instant),
}

impl WriterThread {
    /// Writes what it receives until the channel is closed.
    pub(super) fn run(
        mut self,
        receiver: &Receiver<WriterOrder>,
        recycle: &SyncSender<Vec<RecordedMessage>>,
        flush_every: Duration,
    ) -> RecordingOutcome {
        // The beginning of the part is on its way already.
        self.note_flush();
        let mut failed = None;
        loop {
            match receiver.recv_timeout(flush_every) {
                // After a write error only the metrics continue.
                Ok(WriterOrder::Write(mut batch)) => {
                    let mut sync = false;
                    for record in &batch {
                        self.page.count_written();
                        failed = self.take(record, failed);
                        sync |= self.incidents.observe(record, &self.status.heartbeats);
                    }
                    // The messages before a brake reach the disk before any further ones.
                    if sync && failed.is_none() {
                        failed = self.flush(Writer::sync).err();
                    }
                    self.incidents.write_pending();
                    batch.clear();
                    // A full channel drops the batch and frees its memory.
                    let _ = recycle.try_send(batch);
                }
                Ok(WriterOrder::Flush(answer)) => {
                    if failed.is_none() {
                        failed = self.flush(Writer::flush).err();
                    }
                    if failed.is_some() {
                        // What cannot be written is not tried again.
                        self.note_flush();
                    }
                    let _ = answer.try_send(());
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if failed.is_none() && self.flushed_at.elapsed() >= flush_every {
                failed = self.flush(Writer::flush).and_then(|()| self.disk.check()).err();
            }
            self.tell_tasks();
            if failed.is_some() {
                self.page.set_log_failed();
                // Nothing waits for what cannot be written.
                self.note_flush();
            }
        }
        let (file_bytes, parts) = self.writer.written();
        let figures = LogFigures {
            metrics: self.metrics.summary(),
            active: self.active,
            messages: Topic::ALL.iter().map(|t| self.writer.messages(*t)).sum(),
            ticks: [self.writer.messages(Topic::State), self.writer.messages(Topic::Command)],
            file_bytes,
            parts,
        };
        let (incidents, tasks) = (self.incidents.finish(), self.tasks.report());
        let finished = match failed {
            Some(e) => Err(e),
            None => self.writer.finish(),
        };
        let (figures, error) = match finished {
            Ok(totals) => (LogFigures { file_bytes: totals.file_bytes, parts: totals.parts, ..figures }, None),
            Err(e) => (figures, Some(e.to_string())),
        };
        RecordingOutcome { figures: Some(figures), incidents, tasks, error }
    }

    /// Writes a message, or only counts it after a write error. Flushes when many ticks are not flushed.
    fn take(&mut self, record: &RecordedMessage, failed: Option<LogError>) -> Option<LogError> {
        let part = self.writer.part().0;
        let written = self.record(record, failed.is_none());
        let mut failed = failed.or(written.err());
        if failed.is_none() && self.writer.part().0 != part {
            // The message has begun a new part: all before it are in the old one.
            self.note_flush();
        }
        advance(&mut self.position, record, &self.status);
        if let RecordedMessage::Event(event) = record {
            self.page.set_event(self.position.events, identity(event));
            self.position.events += 1;
        }
        if failed.is_none() && self.position.ticks[0] - self.flushed.ticks[0] >= MAX_UNFLUSHED {
            failed = self.flush(Writer::flush).err();
        }
        failed
    }

    fn flush(&mut self, flush: impl Fn(&mut Writer) -> Result<(), LogError>) -> Result<(), LogError> {
        self.flushed_at = Instant::now();
        flush(&mut self.writer)?;
        self.note_flush();
        Ok(())
    }

    /// Tells the supervisor that everything so far survives this process.
    fn note_flush(&mut self) {
        let (part, bytes) = self.writer.part();
        self.flushed = LogPosition { part, bytes, ..self.position };
        self.page.set_flushed(&self.flushed);
    }

    /// Writes the conditions of the task for the supervisor, if they have changed.
    fn tell_tasks(&mut self) {
        if self.told.1.elapsed() >= TASKS_INTERVAL {
            let report = self.tasks.report();
            if report != self.told.0
                && let Ok(text) = serde_json::to_vec(&report)
            {
                // A failure leaves older conditions; the last ones are in the outcome.
                let _ = replace(&tasks_file(&self.root), &text);
            }
            self.told = (report, Instant::now());
        }
    }

    fn record(&mut self, record: &RecordedMessage, write: bool) -> Result<(), LogError> {
        match record {
            RecordedMessage::State(m) => {
                let state = if write { self.writer.state(m)? } else { hapfic_log::convert::state(m, self.writer.names()) };
                self.metrics.push_state(&state);
                if let (true, Some(event)) = (write, hapfic_log::passage_event(m, self.writer.names())) {
                    let event = self.writer.event(&event)?;
                    self.writer.log(m.tick.max(0), &self.viewer.log_line(&event))?;
                }
                if self.viewer.due(m.tick) {
                    self.frames.state(m, state);
                }
                let events = self.tasks.state(m);
                self.conditions(&events, write)?;
            }
            RecordedMessage::Reference(m) => {
                let reference = if write { self.writer.reference(m)? } else { hapfic_log::convert::reference(m) };
                self.metrics.push_reference(&reference);
                if self.viewer.due(m.tick) {
                    self.frames.reference(m);
                }
                let events = self.tasks.reference(m);
                self.conditions(&events, write)?;
            }
            RecordedMessage::Request(m) => {
                if write {
                    self.writer.request(m)?;
                }
            }
            RecordedMessage::Command(m) => {
                // The command before the first tick only starts the run.
                if m.tick < 0 {
                    return Ok(());
                }
                let command = if write { self.writer.command(m)? } else { hapfic_log::convert::command(m) };
                self.metrics.push_command(&command);
                self.active |= m.mode == Mode::Active.code();
                if self.viewer.due(m.tick) {
                    self.write_frame(m.tick, write)?;
                }
                let events = self.tasks.command(m);
                self.conditions(&events, write)?;
            }
            RecordedMessage::Operator(m) => self.operator(m, write)?,
            RecordedMessage::Event(m) => {
                let event = if write { self.writer.event(m)? } else { hapfic_log::convert::event(m) };
                if write {
                    let line = self.viewer.log_line(&event);
                    self.writer.log(m.tick.max(0), &line)?;
                }
            }
            RecordedMessage::Timing(m) => {
                // Several processes send at their own pace; readers need ascending times.
                self.timing_log_ns = self.timing_log_ns.max(self.writer.time_of(m.tick.max(0)));
                let at = self.timing_log_ns;
                let timing = if write { self.writer.timing(m, at)? } else { hapfic_log::convert::timing(m) };
                // A heartbeat without a published message has no tick times.
                if m.publish_ns > 0 {
                    self.metrics.push_timing(&timing);
                }
            }
        }
        Ok(())
    }

    /// Logs each parameter set once, when it is announced.
    fn operator(&mut self, m: &Operator, write: bool) -> Result<(), LogError> {
        self.tasks.operator(m);
        for set in [&m.current, &m.next] {
            if self.frames.parameters(set) {
                let operator = if write { self.writer.operator(set)? } else { hapfic_log::convert::operator(set) };
                self.metrics.push_operator(&operator);
            }
        }
        Ok(())
    }

    /// Logs conditions of the task that begin or end.
    fn conditions(&mut self, events: &[Event], write: bool) -> Result<(), LogError> {
        for event in events.iter().filter(|_| write) {
            let logged = self.writer.event(event)?;
            self.writer.log(event.tick.max(0), &self.viewer.log_line(&logged))?;
        }
        Ok(())
    }

    fn write_frame(&mut self, tick: i64, write: bool) -> Result<(), LogError> {
        let Some(frame) = self.frames.take(tick) else { return Ok(()) };
        let (m, parameters) = (&frame.state, frame.parameters);
        if write {
            let transforms = self.viewer.transforms(tick, &scene::poses(&self.chain, m));
            self.writer.transforms(tick, &transforms)?;
            let target = parameters.map(|p| p.target_position);
            let update = self.viewer.scene_update(tick, &frame.logged.contacts, frame.reference, target);
            self.writer.scene(tick, &update)?;
        }
        Ok(())
    }
}
