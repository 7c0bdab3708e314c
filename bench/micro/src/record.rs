//! What the recorder does with the messages of a tick: encodes, sums up and writes them, and a picture for viewers now and then.

use hapfic_bench_recorded::Moment;
use hapfic_config::Settings;
use hapfic_log::viewer::{Scene, SceneBody, SceneShape, Shape};
use hapfic_log::{LogError, Metrics, Names, Viewer, Writer, proto};
use hapfic_messages::{Command, Phase, Process, Reference, Request, State, Timing};
use hapfic_robot::Chain;
use std::io::Write;

/// Who accounts for each tick.
pub const ACCOUNTING: [Process; 5] =
    [Process::Plant, Process::Planner, Process::Controller, Process::Standby, Process::Supervisor];
/// Messages of a tick: state, reference, two requests, command, and five accounts.
pub const MESSAGES: usize = 5 + ACCOUNTING.len();

/// A message on its way to the file.
#[allow(clippy::large_enum_variant)] // As the recorder itself has it.
#[derive(Clone, Copy, Debug)]
pub enum Message {
    /// state(k).
    State(State),
    /// reference(k).
    Reference(Reference),
    /// A controller's request(k).
    Request(Request),
    /// command(k).
    Command(Command),
    /// Somebody's account of tick k.
    Timing(Timing),
}

/// The messages of a tick, both controllers answering and all accounting for it: those of a moment, as if it had been at another
/// tick.
#[must_use]
pub fn messages(moment: &Moment, tick: i64) -> [Message; MESSAGES] {
    let stamp_ns = 1_000_000_000_000 + tick as u64 * 1_000_000;
    let made = Request { stamp_ns, tick, state_tick: tick, ..moment.command.request };
    let account = |process: Process| {
        Message::Timing(Timing {
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
    let [plant, planner, controller, standby, gate] = ACCOUNTING.map(account);
    [
        Message::State(State { stamp_ns, tick, time_ns: tick as u64 * 1_000_000, ..moment.state }),
        Message::Reference(Reference { stamp_ns, tick, ..moment.reference }),
        Message::Request(Request { controller: Process::Controller.code(), ..made }),
        Message::Request(Request { controller: Process::Standby.code(), ..made }),
        Message::Command(Command { stamp_ns, tick, request: made, ..moment.command }),
        plant,
        planner,
        controller,
        standby,
        gate,
    ]
}

/// The names that a scenario's log is written with.
#[must_use]
pub fn names(settings: &Settings, chain: &Chain) -> Names {
    Names {
        joints: chain.joints().iter().map(|joint| joint.name.clone()).collect(),
        bodies: Vec::new(),
        objects: settings.world.objects.iter().map(|object| object.name.clone()).collect(),
    }
}

/// The writing half of a recorder.
pub struct Recorder<W: Write> {
    writer: Writer<W>,
    metrics: Metrics,
    viewer: Viewer,
    chain: Chain,
    /// The last state and reference: what a picture shows.
    state: State,
    contacts: Vec<proto::Contact>,
    reference: [f64; 3],
}

impl<W: Write> core::fmt::Debug for Recorder<W> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Recorder").field("bytes", &self.writer.message_bytes()).finish_non_exhaustive()
    }
}

impl<W: Write> Recorder<W> {
    /// Into an open log of a scenario.
    #[must_use]
    pub fn new(writer: Writer<W>, settings: &Settings, chain: &Chain) -> Self {
        let bodies = chain.joints().iter().map(|joint| SceneBody {
            name: joint.child_link.clone(),
            frame: joint.child_link.clone(),
            shapes: vec![SceneShape {
                position: [0.0; 3],
                orientation: [0.0, 0.0, 0.0, 1.0],
                shape: Shape::Cylinder { radius: 0.02, length: 0.3 },
                color: [0.5, 0.5, 0.5, 1.0],
            }],
        });
        let viewer = Viewer::new(Scene { bodies: bodies.collect() }, settings.recorder.viewer_rate_hz.round() as u32, 0);
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

    /// Takes a message in.
    ///
    /// # Errors
    /// [`LogError`] if it cannot be written.
    pub fn record(&mut self, message: &Message) -> Result<(), LogError> {
        match message {
            Message::State(m) => {
                let state = self.writer.state(m)?;
                self.metrics.push_state(&state);
                if self.viewer.due(m.tick) {
                    self.state = *m;
                    self.contacts = state.contacts;
                }
            }
            Message::Reference(m) => {
                self.metrics.push_reference(&self.writer.reference(m)?);
                self.reference = m.position;
            }
            Message::Request(m) => {
                self.writer.request(m)?;
            }
            Message::Command(m) => {
                self.metrics.push_command(&self.writer.command(m)?);
                if self.viewer.due(m.tick) {
                    self.show(m.tick)?;
                }
            }
            Message::Timing(m) => {
                let at = self.writer.time_of(m.tick);
                self.metrics.push_timing(&self.writer.timing(m, at)?);
            }
        }
        Ok(())
    }

    fn show(&mut self, tick: i64) -> Result<(), LogError> {
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

    /// The log that it writes.
    pub fn writer(&mut self) -> &mut Writer<W> {
        &mut self.writer
    }

    /// Ends the log; returns its size, bytes, and how many ticks are missing in it.
    ///
    /// # Errors
    /// [`LogError`] if it cannot be written.
    pub fn finish(self) -> Result<(u64, u64), LogError> {
        let lost = self.metrics.summary().ticks.lost;
        Ok((self.writer.finish()?.file_bytes, lost))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_bench_recorded::moments;
    use hapfic_log::{Reader, Topic, WriterOptions};

    #[test]
    fn the_log_holds_every_message_and_says_which_tick_is_missing() {
        let settings = Settings::load("floor", &[]).unwrap();
        let chain = Chain::from_settings(&settings.robot).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("test.mcap");
        let writer = Writer::create(&path, &names(&settings, &chain), &[], &[], &WriterOptions::default()).unwrap();
        let mut recorder = Recorder::new(writer, &settings, &chain);
        for (tick, moment) in (0..).zip(moments("floor", 100).unwrap()) {
            if tick != 50 {
                messages(&moment, tick).iter().for_each(|m| recorder.record(m).unwrap());
            }
        }
        assert_eq!(recorder.writer().messages(Topic::Timing), 99 * 5);
        let (bytes, lost) = recorder.finish().unwrap();
        assert_eq!(bytes, std::fs::metadata(&path).unwrap().len());
        assert!(lost > 0, "a missing tick is not noticed");
        let found = Reader::open(&path).unwrap().filter(|entry| entry.is_ok()).count();
        assert!(found >= 99 * MESSAGES, "{found}");
    }
}
