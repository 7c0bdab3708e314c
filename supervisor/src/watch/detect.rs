//! What the supervisor notices, and what it does about it.

use super::Watch;
use super::slot::ProcessSlot;
use crate::children::started;
use crate::recorder;
use anyhow::Result;
use hapfic_config::OnLoss;
use hapfic_messages::{Clock, Detector, Phase, Process};
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// In lockstep nothing is lost while a process stands still, so a busy host gets so many times as long.
const LOCKSTEP_TIMEOUT_FACTOR: u64 = 5;

impl Watch<'_> {
    /// Looks at everyone, and does what can be done. `false` if the run has to end.
    pub(super) fn healthy(&mut self) -> Result<bool> {
        if self.shared.asked_to_stop.load(Ordering::Relaxed) {
            self.fault("supervisor", "was asked to end by the operator".to_owned(), "operator");
            return Ok(false);
        }
        if self.stop.load(Ordering::Relaxed) {
            self.fault("supervisor", "was asked to end by a signal".to_owned(), "signal");
            return Ok(false);
        }
        let well = self.check_processes()?;
        if let Some(age) = self.shared.silence_ns(recorder::GATE)
            && age > self.silence_limit_ns()
            && self.shared.heartbeat(recorder::GATE).phase() != Some(Phase::Finished)
        {
            self.fault("gate", format!("has not been heard of for {} ms", age / 1_000_000), "heartbeat");
            return Ok(false);
        }
        if well && self.shared.go.load(Ordering::Relaxed) {
            self.inject()?;
            if self.stalled()? {
                return Ok(false);
            }
        }
        if self.shared.log_failed.load(Ordering::Acquire) || self.recorder.failed() {
            self.fault("recorder", "cannot write the log any further".to_owned(), "recorder");
            return Ok(false);
        }
        if well && self.gate.as_ref().is_some_and(JoinHandle::is_finished) {
            let done = self.shared.gated.load(Ordering::Acquire) + 1 >= self.settings.duration_ticks as i64;
            if !done {
                self.fault("gate", "ended too early".to_owned(), "exit");
                return Ok(false);
            }
        }
        Ok(well)
    }

    /// Age of the last signal of restart at which a process counts as lost, ns.
    pub(super) fn silence_limit_ns(&self) -> u64 {
        let patience = if self.clock == Clock::Lockstep { LOCKSTEP_TIMEOUT_FACTOR } else { 1 };
        u64::from(self.settings.supervisor.heartbeat_timeout_ms) * patience * 1_000_000
    }

    /// The third detector, for all together: everybody lives, and no tick is done.
    fn stalled(&mut self) -> Result<bool> {
        let gated = self.shared.gated.load(Ordering::Acquire);
        let joining = self.slots.iter().any(ProcessSlot::joining);
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
        let rejected: Vec<_> = started(self.settings)
            .iter()
            .chain([&recorder::GATE])
            .filter(|p| self.shared.heartbeat(**p).rejected() > 0)
            .map(|p| format!("{p} {}", self.shared.heartbeat(*p).rejected()))
            .collect();
        let rejected = if rejected.is_empty() { "none".to_owned() } else { rejected.join(", ") };
        if self.clock == Clock::Lockstep && !std::mem::replace(&mut self.all_started_anew, true) {
            // One of them has not said what another waits for. The clock waits, so all may start anew.
            let what = format!(
                "is started anew with the others: no tick was done for {} ms; messages rejected: {rejected}",
                limit.as_millis()
            );
            for process in [Process::Planner, Process::Controller, Process::Standby] {
                if !self.on_lost(process, Detector::Tick, &what)? {
                    return Ok(true);
                }
            }
            return Ok(false);
        }
        if self.settings.plant.on_loss == OnLoss::Restart && std::mem::take(&mut self.spare_the_plant) {
            // Then the one that all others wait for.
            let what = format!("has done no tick for {} ms; messages rejected: {rejected}", limit.as_millis());
            return Ok(!self.on_lost(Process::Plant, Detector::Tick, &what)?);
        }
        self.fault(
            "gate",
            format!("has had nothing to pass on for {} ms; messages rejected: {rejected}", limit.as_millis()),
            "tick",
        );
        Ok(true)
    }
}
