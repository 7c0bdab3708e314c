//! The detectors of the supervisor, and its reaction to what they find.

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

/// Factor of the time-outs in lockstep, where a late process costs nothing and the host may be busy.
const LOCKSTEP_TIMEOUT_FACTOR: u64 = 5;

impl Watch<'_> {
    /// Checks all processes and threads, and restarts what is lost; `false` if the run must end.
    pub(super) fn healthy(&mut self) -> Result<bool> {
        if self.shared.asked_to_stop.load(Ordering::Relaxed) {
            self.fault("supervisor", "was asked to end by the operator".to_owned(), "operator");
            return Ok(false);
        }
        if self.stop.load(Ordering::Relaxed) {
            self.fault("supervisor", "was asked to end by a signal".to_owned(), "signal");
            return Ok(false);
        }
        let healthy = self.check_processes()?;
        if let Some(age) = self.shared.silence_ns(recorder::GATE)
            && age > self.silence_limit_ns()
            && self.shared.heartbeat(recorder::GATE).phase() != Some(Phase::Finished)
        {
            self.fault("gate", format!("has sent no heartbeat for {} ms", age / 1_000_000), "heartbeat");
            return Ok(false);
        }
        if healthy && self.shared.go.load(Ordering::Relaxed) {
            self.inject()?;
            if self.stalled()? {
                return Ok(false);
            }
        }
        if self.shared.log_failed.load(Ordering::Acquire) || self.recorder.failed() {
            self.fault("recorder", "cannot write the log any further".to_owned(), "recorder");
            return Ok(false);
        }
        if healthy && self.gate.as_ref().is_some_and(JoinHandle::is_finished) {
            let done = self.shared.gated.load(Ordering::Acquire) + 1 >= self.settings.duration_ticks as i64;
            if !done {
                self.fault("gate", "ended too early".to_owned(), "exit");
                return Ok(false);
            }
        }
        Ok(healthy)
    }

    /// Heartbeat age at which a process counts as lost [ns].
    pub(super) fn silence_limit_ns(&self) -> u64 {
        let factor = if self.clock == Clock::Lockstep { LOCKSTEP_TIMEOUT_FACTOR } else { 1 };
        u64::from(self.settings.supervisor.heartbeat_timeout_ms) * factor * 1_000_000
    }

    /// The tick detector for all processes together: all live, and no tick is done.
    fn stalled(&mut self) -> Result<bool> {
        let gated = self.shared.gated.load(Ordering::Acquire);
        let joining = self.slots.iter().any(ProcessSlot::joining);
        if gated != self.advanced.0 {
            (self.plant_restart_left, self.all_restarted) = (true, false);
        }
        if gated != self.advanced.0 || gated + 1 >= self.settings.duration_ticks as i64 {
            self.advanced = (gated, Instant::now());
            return Ok(false);
        }
        let limit = Duration::from_millis(self.settings.supervisor.stall_timeout_ms.into());
        // A starting process needs time, but it may also wait for a message that never comes.
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
        if self.clock == Clock::Lockstep && !std::mem::replace(&mut self.all_restarted, true) {
            // A process waits for a message that another has not sent. The clock waits, so all may restart.
            let what = format!(
                "is restarted with the others: no tick was done for {} ms; messages rejected: {rejected}",
                limit.as_millis()
            );
            for process in [Process::Planner, Process::Controller, Process::Standby] {
                if !self.on_lost(process, Detector::Tick, &what)? {
                    return Ok(true);
                }
            }
            return Ok(false);
        }
        if self.settings.plant.on_loss == OnLoss::Restart && std::mem::take(&mut self.plant_restart_left) {
            // Then the plant, for which all others wait.
            let what = format!("has done no tick for {} ms; messages rejected: {rejected}", limit.as_millis());
            return Ok(!self.on_lost(Process::Plant, Detector::Tick, &what)?);
        }
        self.fault(
            "gate",
            format!("has published no command for {} ms; messages rejected: {rejected}", limit.as_millis()),
            "tick",
        );
        Ok(true)
    }
}
