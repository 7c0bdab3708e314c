//! Log of a simulation: the messages that the recorder writes in lockstep, as far as one process has them.

use crate::Snapshot;
use anyhow::Result;
use hapfic_config::Settings;
use hapfic_log::{LogError, LogTotals, RunLog, Viewer, Writer, proto};
use hapfic_messages::{Clock, Event, Operator, Parameters};
use hapfic_plant::Plant;
use hapfic_robot::Chain;
use std::path::Path;

/// Writer of the log of a simulation.
///
/// `/state`, `/reference`, `/request`, `/command`, `/operator`, `/tf` and `/scene` have the same bytes as in lockstep.
/// `/request/standby` and `/timing` are empty, `/event` and `/log` have passages and conditions of the task alone: one process has no
/// standby, no waits and no losses.
pub struct Recording {
    writer: Writer,
    viewer: Viewer,
    chain: Chain,
}

impl Recording {
    /// Creates the log.
    ///
    /// # Errors
    /// If the plant cannot be built or the log cannot be created.
    pub fn create(scenario: &str, settings: &Settings, log: &Path) -> Result<Self> {
        let plant = Plant::new(settings)?;
        let writer = hapfic_log::create_run_log(&RunLog {
            path: log,
            scenario,
            settings,
            clock: Clock::Lockstep,
            chain: plant.chain(),
            body_names: plant.body_names(),
            start_unix_ns: 0,
        })?;
        let viewer =
            Viewer::new(hapfic_log::scene::scene(settings, plant.chain()), settings.recorder.viewer_rate_hz.round() as u32, 0);
        Ok(Self { writer, viewer, chain: plant.chain().clone() })
    }

    /// Writes a parameter set; returns the written message.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn set(&mut self, set: &Parameters) -> Result<proto::Operator, LogError> {
        self.writer.operator(set)
    }

    /// Writes a tick; returns the written messages.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn tick(&mut self, tick: &Snapshot) -> Result<(proto::State, proto::Reference, proto::Command), LogError> {
        let state = self.writer.state(&tick.state)?;
        if let Some(event) = hapfic_log::passage_event(&tick.state, self.writer.names()) {
            let event = self.writer.event(&event)?;
            self.writer.log(tick.state.tick, &self.viewer.log_line(&event))?;
        }
        let reference = self.writer.reference(&tick.reference)?;
        self.writer.request(&tick.command.request)?;
        let command = self.writer.command(&tick.command)?;
        if self.viewer.due(tick.state.tick) {
            self.write_viewer_frame(tick, &state, &tick.operator)?;
        }
        Ok((state, reference, command))
    }

    fn write_viewer_frame(&mut self, now: &Snapshot, state: &proto::State, operator: &Operator) -> Result<(), LogError> {
        let tick = now.state.tick;
        let transforms = self.viewer.transforms(tick, &hapfic_log::scene::poses(&self.chain, &now.state));
        self.writer.transforms(tick, &transforms)?;
        let target = operator.at(tick).target_position;
        let update = self.viewer.scene_update(tick, &state.contacts, Some(now.reference.position), Some(target));
        self.writer.scene(tick, &update)
    }

    /// Writes an event of the task.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn event(&mut self, event: &Event) -> Result<(), LogError> {
        let logged = self.writer.event(event)?;
        self.writer.log(event.tick.max(0), &self.viewer.log_line(&logged))
    }

    /// Closes the log.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn finish(self) -> Result<LogTotals, LogError> {
        self.writer.finish()
    }
}
