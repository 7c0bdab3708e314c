//! What the supervisor notices, and what it does about it.

use super::Watch;
use super::slot::Slot;
use crate::children::started;
use crate::recorder;
use anyhow::Result;
use hapfic_config::OnLoss;
use hapfic_messages::{Clock, Detector, Phase, Process};
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// In lockstep nothing is lost while a process stands still, so a busy host gets so many times as long.
const LOCKSTEP_PATIENCE: u64 = 5;

impl Watch<'_> {
    /// Looks at everyone, and does what can be done. `false` if the run has to end.
    pub(super) fn all_well(&mut self) -> Result<bool> {
        if self.live.asked_to_stop.load(Ordering::Relaxed) {
            self.fault("supervisor", "was asked to end by the operator".to_owned(), "operator");
            return Ok(false);
        }
        if self.stop.load(Ordering::Relaxed) {
            self.fault("supervisor", "was asked to end by a signal".to_owned(), "signal");
            return Ok(false);
        }
        let well = self.look_after_processes()?;
        if let Some(age) = self.live.silence_ns(recorder::GATE)
            && age > self.patience_ns()
            && self.live.pulse(recorder::GATE).phase() != Some(Phase::Finished)
        {
            self.fault("gate", format!("has not been heard of for {} ms", age / 1_000_000), "heartbeat");
            return Ok(false);
        }
        if well && self.live.go.load(Ordering::Relaxed) {
            self.inject()?;
            if self.stalled()? {
                return Ok(false);
            }
        }
        if self.live.log_failed.load(Ordering::Acquire) || self.recorder.failed() {
            self.fault("recorder", "cannot write the log any further".to_owned(), "recorder");
            return Ok(false);
        }
        if well && self.gate.as_ref().is_some_and(JoinHandle::is_finished) {
            let done = self.live.gated.load(Ordering::Acquire) + 1 >= self.settings.duration_ticks as i64;
            if !done {
                self.fault("gate", "ended too early".to_owned(), "exit");
                return Ok(false);
            }
        }
        Ok(well)
    }

    /// Age of the last sign of life at which a process counts as lost, ns.
    pub(super) fn patience_ns(&self) -> u64 {
        let patience = if self.clock == Clock::Lockstep { LOCKSTEP_PATIENCE } else { 1 };
        u64::from(self.settings.supervisor.heartbeat_timeout_ms) * patience * 1_000_000
    }

    /// The third detector, for all together: everybody lives, and no tick is done.
    fn stalled(&mut self) -> Result<bool> {
        let gated = self.live.gated.load(Ordering::Acquire);
        let joining = self.slots.iter().any(Slot::joining);
        if gated != self.advanced.0 {
            (self.spare_the_plant, self.all_started_anew) = (true, false);
        }
        if gated != self.advanced.0 || gated + 1 >= self.settings.duration_ticks as i64 {
            self.advanced = (gated, Instant::now());
            return Ok(false);
        }
        let limit = Duration::from_millis(self.settings.supervisor.stall_timeout_ms.into());
        // Who joins needs some time; but he may also wait for somebody in vain.
        if self.advanced.1.elapsed() <= if joining { 2 * limit } else { limit } {
            return Ok(false);
        }
        self.advanced = (gated, Instant::now());
        let refused: Vec<_> = started(self.settings)
            .iter()
            .chain([&recorder::GATE])
            .filter(|p| self.live.pulse(**p).refused() > 0)
            .map(|p| format!("{p} {}", self.live.pulse(*p).refused()))
            .collect();
        let refused = if refused.is_empty() { "none".to_owned() } else { refused.join(", ") };
        if self.clock == Clock::Lockstep && !std::mem::replace(&mut self.all_started_anew, true) {
            // One of them has not said what another waits for. The clock waits, so all may start anew.
            let what = format!(
                "is started anew with the others: no tick was done for {} ms; messages refused: {refused}",
                limit.as_millis()
            );
            for process in [Process::Planner, Process::Controller, Process::Standby] {
                if !self.lose(process, Detector::Tick, &what)? {
                    return Ok(true);
                }
            }
            return Ok(false);
        }
        if self.settings.plant.on_loss == OnLoss::Restart && std::mem::take(&mut self.spare_the_plant) {
            // Then the one that all others wait for.
            let what = format!("has done no tick for {} ms; messages refused: {refused}", limit.as_millis());
            return Ok(!self.lose(Process::Plant, Detector::Tick, &what)?);
        }
        self.fault(
            "gate",
            format!("has had nothing to pass on for {} ms; messages refused: {refused}", limit.as_millis()),
            "tick",
        );
        Ok(true)
    }
}
