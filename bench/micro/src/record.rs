//! The recorder's work on the messages of a tick: encoding, metrics, writing, and viewer frames at a lower rate.

use hapfic_bench_recorded::RecordedTick;
use hapfic_config::Settings;
use hapfic_log::viewer::{SceneBody, SceneShape, ViewerScene, ViewerShape};
use hapfic_log::{LogError, Metrics, Names, Viewer, Writer, proto};
use hapfic_messages::{Command, Phase, Process, Reference, Request, State, Timing};
use hapfic_robot::Chain;
use std::io::Write;

/// Processes that publish timing each tick.
pub const TIMED_PROCESSES: [Process; 5] =
    [Process::Plant, Process::Planner, Process::Controller, Process::Standby, Process::Gate];
/// Messages of a tick: state, reference, two requests, command, and five of timing.
pub const MESSAGES: usize = 5 + TIMED_PROCESSES.len();

/// A message between port and file.
#[allow(clippy::large_enum_variant)] // The recorder's own enum has the same sizes.
#[derive(Clone, Copy, Debug)]
pub enum RecordedMessage {
    /// state(k).
    State(State),
    /// reference(k).
    Reference(Reference),
    /// request(k) of a controller.
    Request(Request),
    /// command(k).
    Command(Command),
    /// Timing of a process at tick k.
    Timing(Timing),
}

/// Returns the messages of a recorded tick, moved to another tick.
///
/// Both controllers send a request, and all processes publish their timing.
#[must_use]
pub fn messages(recorded: &RecordedTick, tick: i64) -> [RecordedMessage; MESSAGES] {
    let stamp_ns = 1_000_000_000_000 + tick as u64 * 1_000_000;
    let request = Request { stamp_ns, tick, state_tick: tick, ..recorded.command.request };
    let timing = |process: Process| {
        RecordedMessage::Timing(Timing {
            process: process.code(),
            phase: Phase::Running.code(),
            tick,
            due_ns: stamp_ns,
            wake_ns: stamp_ns + 30_123,
            publish_ns: stamp_ns + 54_321,
            latency_ns: 54_321,
            ..Timing::default()
        })
    };
    let [plant, planner, controller, standby, gate] = TIMED_PROCESSES.map(timing);
    [
        RecordedMessage::State(State { stamp_ns, tick, time_ns: tick as u64 * 1_000_000, ..recorded.state }),
        RecordedMessage::Reference(Reference { stamp_ns, tick, ..recorded.reference }),
        RecordedMessage::Request(Request { controller: Process::Controller.code(), ..request }),
        RecordedMessage::Request(Request { controller: Process::Standby.code(), ..request }),
        RecordedMessage::Command(Command { stamp_ns, tick, request, ..recorded.command }),
        plant,
        planner,
        controller,
        standby,
        gate,
    ]
}

/// Returns the names in the log of a scenario.
#[must_use]
pub fn names(settings: &Settings, chain: &Chain) -> Names {
    Names {
        joints: chain.joints().iter().map(|joint| joint.name.clone()).collect(),
        bodies: Vec::new(),
        objects: settings.world.objects.iter().map(|object| object.name.clone()).collect(),
    }
}

/// The writer of a recorder.
pub struct RecorderWriter<W: Write> {
    writer: Writer<W>,
    metrics: Metrics,
    viewer: Viewer,
    chain: Chain,
    /// Last state and reference, for the viewer frame.
    state: State,
    contacts: Vec<proto::Contact>,
    reference: [f64; 3],
}

impl<W: Write> core::fmt::Debug for RecorderWriter<W> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("RecorderWriter").field("bytes", &self.writer.message_bytes()).finish_non_exhaustive()
    }
}

impl<W: Write> RecorderWriter<W> {
    /// Creates the writer into an open log of a scenario.
    #[must_use]
    pub fn new(writer: Writer<W>, settings: &Settings, chain: &Chain) -> Self {
        let bodies = chain.joints().iter().map(|joint| SceneBody {
            name: joint.child_link.clone(),
            frame: joint.child_link.clone(),
            shapes: vec![SceneShape {
                position: [0.0; 3],
                orientation: [0.0, 0.0, 0.0, 1.0],
                shape: ViewerShape::Cylinder { radius: 0.02, length: 0.3 },
                color: [0.5, 0.5, 0.5, 1.0],
            }],
        });
        let viewer = Viewer::new(ViewerScene { bodies: bodies.collect() }, settings.recorder.viewer_rate_hz.round() as u32, 0);
        Self {
            writer,
            metrics: Metrics::new(),
            viewer,
            chain: chain.clone(),
            state: State::default(),
            contacts: Vec::new(),
            reference: [0.0; 3],
        }
    }

    /// Writes a message, and adds it to the metrics.
    ///
    /// # Errors
    /// [`LogError`] if the message cannot be written.
    pub fn record(&mut self, message: &RecordedMessage) -> Result<(), LogError> {
        match message {
            RecordedMessage::State(m) => {
                let state = self.writer.state(m)?;
                self.metrics.push_state(&state);
                if self.viewer.due(m.tick) {
                    self.state = *m;
                    self.contacts = state.contacts;
                }
            }
            RecordedMessage::Reference(m) => {
                self.metrics.push_reference(&self.writer.reference(m)?);
                self.reference = m.position;
            }
            RecordedMessage::Request(m) => {
                self.writer.request(m)?;
            }
            RecordedMessage::Command(m) => {
                self.metrics.push_command(&self.writer.command(m)?);
                if self.viewer.due(m.tick) {
                    self.write_viewer_frame(m.tick)?;
                }
            }
            RecordedMessage::Timing(m) => {
                let log_time_ns = self.writer.time_of(m.tick);
                self.metrics.push_timing(&self.writer.timing(m, log_time_ns)?);
            }
        }
        Ok(())
    }

    fn write_viewer_frame(&mut self, tick: i64) -> Result<(), LogError> {
        let n = self.chain.dof();
        let kin = self.chain.kinematics(&self.state.joint_position[..n]);
        let poses: Vec<_> = (0..n)
            .map(|i| {
                let pose = kin.body_pose(i);
                let q = pose.rotation;
                (pose.translation.vector.into(), [q.i, q.j, q.k, q.w])
            })
            .collect();
        self.writer.transforms(tick, &self.viewer.transforms(tick, &poses))?;
        let update = self.viewer.scene_update(tick, &self.contacts, Some(self.reference), Some([0.0; 3]));
        self.writer.scene(tick, &update)
    }

    /// Returns the log's writer.
    pub fn writer(&mut self) -> &mut Writer<W> {
        &mut self.writer
    }

    /// Ends the log. Returns its size [bytes], and the number of missing ticks.
    ///
    /// # Errors
    /// [`LogError`] if the log cannot be written.
    pub fn finish(self) -> Result<(u64, u64), LogError> {
        let lost = self.metrics.summary().ticks.lost;
        Ok((self.writer.finish()?.file_bytes, lost))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_bench_recorded::recorded_ticks;
    use hapfic_log::{Reader, Topic, WriterOptions};

    #[test]
    fn recorder_writer_missing_tick_is_reported() {
        let settings = Settings::load("floor", &[]).unwrap();
        let chain = Chain::from_settings(&settings.robot).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("test.mcap");
        let writer = Writer::create(&path, &names(&settings, &chain), &[], &[], &WriterOptions::default()).unwrap();
        let mut recorder = RecorderWriter::new(writer, &settings, &chain);
        for (tick, recorded) in (0..).zip(recorded_ticks("floor", 100).unwrap()) {
            if tick != 50 {
                messages(&recorded, tick).iter().for_each(|m| recorder.record(m).unwrap());
            }
        }
        assert_eq!(recorder.writer().messages(Topic::Timing), 99 * 5);
        let (bytes, lost) = recorder.finish().unwrap();
        assert_eq!(bytes, std::fs::metadata(&path).unwrap().len());
        assert!(lost > 0, "the missing tick is not reported");
        let found = Reader::open(&path).unwrap().filter(|entry| entry.is_ok()).count();
        assert!(found >= 99 * MESSAGES, "found {found} messages");
    }
}
