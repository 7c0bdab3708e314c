//! The recorder among the processes of a run: it takes part in no tick, so its loss stops nothing.

use super::Watch;
use crate::children::Child;
use crate::log_line;
use anyhow::Result;
use hapfic_config::OnFailure;
use hapfic_gate::restart_policy::RestartStage;
use hapfic_messages::{Clock, Credit, Detector, EventKind, Process};
use std::sync::atomic::Ordering;

/// What has become of the recorder's process at the end of a run.
#[derive(Debug)]
pub enum RecorderEnd {
    /// It runs.
    Running(Child),
    /// It is lost, and no successor has started yet.
    Lost,
    /// It was lost too often, or its log cannot be continued.
    GivenUp,
}

impl Watch<'_> {
    /// Takes the recorder's process out of the watch, with its generation: it ends last.
    pub fn take_recorder(&mut self) -> (RecorderEnd, u32) {
        let Some(slot) = self.slots.iter_mut().find(|slot| slot.process == Process::Recorder) else {
            return (RecorderEnd::GivenUp, 0);
        };
        let end = match slot.child.take() {
            Some(child) => RecorderEnd::Running(child),
            None if slot.restart.stage == RestartStage::BudgetSpent => RecorderEnd::GivenUp,
            None => RecorderEnd::Lost,
        };
        (end, slot.generation)
    }

    /// Handles a recorder that does not start again: the run ends, or goes on without a log, as `recorder.on_failure` says.
    /// Returns whether it goes on.
    pub(super) fn recorder_given_up(&mut self, what: &str) -> Result<bool> {
        self.run.record.process(Process::Recorder).given_up.store(1, Ordering::Relaxed);
        if self.run.settings.recorder.on_failure == OnFailure::Stop {
            self.fault(Process::Recorder.name(), what.to_owned(), Detector::Recorder);
            return Ok(false);
        }
        self.note(
            Process::Recorder,
            EventKind::Lost,
            Detector::Recorder,
            &format!("the run goes on without a log: recorder {what}"),
        );
        log_line(&format!("hapfic: the run goes on without a log: recorder {what}"));
        self.grant_all()?;
        Ok(true)
    }

    /// Grants the plant all ticks, in lockstep: nothing limits it without a recorder.
    pub(super) fn grant_all(&mut self) -> Result<()> {
        if self.run.clock == Clock::Lockstep {
            self.credit.send(&Credit { tick: i64::MAX / 2 })?;
            self.credit.preloan();
        }
        Ok(())
    }
}
