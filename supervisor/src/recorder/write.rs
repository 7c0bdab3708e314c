//! The writer thread: encodes and writes messages, computes the metrics, and keeps the post-mortem.

use super::disk::Disk;
use super::incident::PostMortem;
use super::viewer_frames::ViewerFrames;
use super::{LatestMessages, RecordedMessage, RecordingResult, WriterResult};
use hapfic_gate_process::status::{SharedStatus, StatusSnapshot};
use hapfic_log::{LogError, Metrics, Topic, Viewer, Writer, scene};
use hapfic_messages::{Event, Mode, Operator};
use hapfic_robot::Chain;
use hapfic_simulation::conditions::TaskFollower;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::time::{Duration, Instant};

/// Writer of the log, with the metrics and the viewer frames of the run.
pub(super) struct WriterThread {
    pub(super) writer: Writer,
    pub(super) viewer: Viewer,
    pub(super) chain: Chain,
    pub(super) tasks: TaskFollower,
    pub(super) latest: Arc<LatestMessages>,
    pub(super) shared: Arc<SharedStatus>,
    pub(super) metrics: Metrics,
    pub(super) frames: ViewerFrames,
    pub(super) active: bool,
    pub(super) timing_log_ns: u64,
    pub(super) incidents: PostMortem,
    pub(super) disk: Disk,
}

impl WriterThread {
    pub(super) fn run(
        mut self,
        receiver: &Receiver<Vec<RecordedMessage>>,
        recycle: &SyncSender<Vec<RecordedMessage>>,
        flush_every: Duration,
    ) -> WriterResult {
        let mut failed = None;
        let mut flushed = Instant::now();
        loop {
            match receiver.recv_timeout(flush_every) {
                // After a write error only the metrics continue.
                Ok(mut batch) => {
                    let mut sync = false;
                    for record in &batch {
                        self.shared.recorder.written.fetch_add(1, Ordering::Relaxed);
                        let written = self.record(record, failed.is_none());
                        failed = failed.or(written.err());
                        sync |= self.incidents.observe(record, &self.shared);
                    }
                    // The messages before a brake reach the disk before any further ones.
                    if sync && failed.is_none() {
                        failed = self.writer.sync().err();
                        flushed = Instant::now();
                    }
                    self.incidents.write_pending();
                    self.latest.set_tasks(self.tasks.report());
                    batch.clear();
                    // A full channel drops the batch and frees its memory.
                    let _ = recycle.try_send(batch);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if failed.is_none() && flushed.elapsed() >= flush_every {
                failed = self.writer.flush().and_then(|()| self.disk.check()).err();
                flushed = Instant::now();
            }
            if failed.is_some() {
                self.shared.recorder.log_failed.store(true, Ordering::Release);
            }
        }
        let (file_bytes, parts) = self.writer.written();
        let recorded = RecordingResult {
            metrics: self.metrics.summary(),
            active: self.active,
            messages: Topic::ALL.iter().map(|t| self.writer.messages(*t)).sum(),
            ticks: [self.writer.messages(Topic::State), self.writer.messages(Topic::Command)],
            file_bytes,
            parts,
        };
        let finished = match failed {
            Some(e) => Err(e),
            None => self.writer.finish(),
        };
        (finished, recorded, self.incidents.finish())
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
                    self.write_frame(m.tick, m.mode, write)?;
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

    fn write_frame(&mut self, tick: i64, mode: u32, write: bool) -> Result<(), LogError> {
        let Some(frame) = self.frames.take(tick) else { return Ok(()) };
        let (m, parameters) = (&frame.state, frame.parameters);
        if write {
            let transforms = self.viewer.transforms(tick, &scene::poses(&self.chain, m));
            self.writer.transforms(tick, &transforms)?;
            let target = parameters.map(|p| p.target_position);
            let update = self.viewer.scene_update(tick, &frame.logged.contacts, frame.reference, target);
            self.writer.scene(tick, &update)?;
        }
        if let Ok(mut snapshot) = self.shared.recorder.snapshot.lock() {
            *snapshot = StatusSnapshot {
                time_s: m.time_ns as f64 * 1e-9,
                foot_position: m.foot_position,
                foot_force: m.foot_force,
                desired_force: parameters.map_or([0.0; 3], |p| p.desired_force),
                late: m.slipped,
                mode,
                tracking: frame.reference.map_or([0.0; 3], |x_d| std::array::from_fn(|i| m.foot_position[i] - x_d[i])),
                bound: parameters.map_or([0.0; 3], |p| p.position_bound),
                version: parameters.map_or(0, |p| p.version),
            };
        }
        Ok(())
    }
}
