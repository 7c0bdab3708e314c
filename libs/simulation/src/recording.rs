//! The log of a simulation: what the recorder of the processes in lockstep writes, as far as one process has it.

use crate::Snapshot;
use anyhow::Result;
use hapfic_config::Settings;
use hapfic_log::{LogError, RunLog, Totals, Viewer, Writer, proto};
use hapfic_messages::{Clock, Operator, Parameters};
use hapfic_plant::Plant;
use hapfic_robot::Chain;
use std::path::Path;

/// A log that is being written.
///
/// It has `/state`, `/reference`, `/request`, `/command`, `/operator`, `/tf` and `/scene`, each with the bytes that the processes
/// give in lockstep. There is no standby, nobody waits, and nothing is lost: `/request/standby`, `/timing`, `/event` and `/log`
/// are empty.
pub struct Recording {
    writer: Writer,
    viewer: Viewer,
    chain: Chain,
}

impl Recording {
    /// Creates the log.
    ///
    /// # Errors
    /// If it cannot be written there.
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

    /// Writes a parameter set; returns what was written.
    ///
    /// # Errors
    /// [`LogError::Write`], as for all that write.
    pub fn set(&mut self, set: &Parameters) -> Result<proto::Operator, LogError> {
        self.writer.operator(set)
    }

    /// Writes a tick; returns what was written.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn tick(&mut self, tick: &Snapshot) -> Result<(proto::State, proto::Reference, proto::Command), LogError> {
        let state = self.writer.state(&tick.state)?;
        let reference = self.writer.reference(&tick.reference)?;
        self.writer.request(&tick.command.request)?;
        let command = self.writer.command(&tick.command)?;
        if self.viewer.due(tick.state.tick) {
            self.show(tick, &state, &tick.operator)?;
        }
        Ok((state, reference, command))
    }

    fn show(&mut self, now: &Snapshot, state: &proto::State, operator: &Operator) -> Result<(), LogError> {
        let tick = now.state.tick;
        let transforms = self.viewer.transforms(tick, &hapfic_log::scene::poses(&self.chain, &now.state));
        self.writer.transforms(tick, &transforms)?;
        let target = operator.at(tick).target_position;
        let update = self.viewer.scene_update(tick, &state.contacts, Some(now.reference.position), Some(target));
        self.writer.scene(tick, &update)
    }

    /// Closes the log.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn finish(self) -> Result<Totals, LogError> {
        self.writer.finish()
    }
}
