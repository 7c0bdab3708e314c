//! The detectors of the supervisor, and its reaction to what they find.

use super::evidence::Suspicion;
use super::slot::ProcessSlot;
use super::{FAST_POLL_INTERVAL, Watch};
use crate::children::started;
use anyhow::Result;
use hapfic_config::{OnFailure, OnLoss};
use hapfic_messages::{Clock, Detector, Process, Severity};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Time that the gate may take for a latched stop before the run ends.
const BRAKE_TIMEOUT: Duration = Duration::from_millis(300);
/// Factor of the time-outs in lockstep, where a late process costs nothing and the machine may be busy.
const LOCKSTEP_TIMEOUT_FACTOR: u64 = 5;

impl Watch<'_> {
    /// Checks all processes and threads, and restarts what is lost; `false` if the run must end.
    pub(super) fn healthy(&mut self) -> Result<bool> {
        if self.run.shared.operator.end_requested.load(Ordering::Relaxed) {
            self.fault("supervisor", "was asked to end by the operator".to_owned(), Detector::Operator);
            return Ok(false);
        }
        if self.run.stop.load(Ordering::Relaxed) {
            self.fault("supervisor", "was asked to end by a signal".to_owned(), Detector::Signal);
            return Ok(false);
        }
        let now_ns = hapfic_ipc::clock::now_ns();
        self.run.record.beat(now_ns);
        if rustix::process::getppid().is_none_or(|parent| parent.as_raw_nonzero().get() != self.run.launcher_pid) {
            self.brake();
            self.fault("launcher", "was lost, and without it no supervisor could be replaced".to_owned(), Detector::Exit);
            return Ok(false);
        }
        self.evidence.observe(&self.run.shared.heartbeats, now_ns);
        let delay_ns = self.evidence.largest_delay().as_nanos() as u64;
        self.run.record.largest_delay_ns.fetch_max(delay_ns, Ordering::Relaxed);
        let healthy = self.check_processes()?;
        if healthy && self.run.shared.orders.start.load(Ordering::Relaxed) {
            self.inject()?;
            if self.stalled()? {
                return Ok(false);
            }
        }
        let stops = self.run.settings.recorder.on_failure == OnFailure::Stop;
        if stops && self.run.recorder.page().log_failed() {
            self.fault("recorder", "cannot write the log any further".to_owned(), Detector::Recorder);
            return Ok(false);
        }
        Ok(healthy)
    }

    /// Lets the drive brake: requests a latched stop, and waits for it.
    fn brake(&self) {
        if !self.run.shared.orders.start.load(Ordering::Relaxed) {
            return;
        }
        self.run.shared.orders.stop_latched(Detector::Exit);
        let begun = Instant::now();
        while self.run.shared.gate.severity.load(Ordering::Relaxed) != Severity::Stopped.code() && begun.elapsed() < BRAKE_TIMEOUT
        {
            std::thread::sleep(FAST_POLL_INTERVAL);
        }
    }

    /// Heartbeat age at which a process counts as lost [ns].
    pub(super) fn silence_limit_ns(&self) -> u64 {
        let factor = if self.run.clock == Clock::Lockstep { LOCKSTEP_TIMEOUT_FACTOR } else { 1 };
        u64::from(self.run.settings.supervisor.heartbeat_timeout_ms) * factor * 1_000_000
    }

    /// Detects that all processes together do no tick although each is alive; returns whether the run must end.
    fn stalled(&mut self) -> Result<bool> {
        let gated = self.run.shared.gate.tick.load(Ordering::Acquire);
        let joining = self.slots.iter().any(ProcessSlot::joining);
        if gated != self.stall.advanced.0 {
            (self.stall.plant_restart_left, self.stall.all_restarted) = (true, false);
        }
        if gated != self.stall.advanced.0 || gated + 1 >= self.run.settings.duration_ticks as i64 {
            self.stall.advanced = (gated, self.evidence.observed_ns());
            return Ok(false);
        }
        let limit_ms = u64::from(self.run.settings.supervisor.stall_timeout_ms);
        let limit_ns = limit_ms * 1_000_000;
        let silent_ns = self.evidence.observed_ns() - self.stall.advanced.1;
        if silent_ns < limit_ns / 2 {
            self.stall.suspicions.clear();
        } else if self.stall.suspicions.is_empty() {
            let children = self.slots.iter().filter_map(|slot| slot.child.as_ref());
            self.stall.suspicions = children.map(|child| Suspicion::begin(child.pid(), &self.evidence)).collect();
        }
        // A starting process needs time, but it may also wait for a message that never comes.
        if silent_ns <= if joining { 2 * limit_ns } else { limit_ns } {
            return Ok(false);
        }
        let excused = self.stall.suspicions.iter_mut().any(|suspicion| suspicion.excuse(&self.evidence));
        if excused {
            // The others wait for a process that waits for a processor.
            self.stall.advanced.1 = self.evidence.observed_ns().saturating_sub(limit_ns / 2);
            return Ok(false);
        }
        self.stall.advanced = (gated, self.evidence.observed_ns());
        let rejected: Vec<_> = started(self.run.settings)
            .iter()
            .filter(|p| self.run.shared.heartbeats.read(**p).rejected > 0)
            .map(|p| format!("{p} {}", self.run.shared.heartbeats.read(*p).rejected))
            .collect();
        let rejected = if rejected.is_empty() { "none".to_owned() } else { rejected.join(", ") };
        if self.run.clock == Clock::Lockstep && !std::mem::replace(&mut self.stall.all_restarted, true) {
            // A process waits for a message that another has not sent. The clock waits, so all may restart.
            let what =
                format!("is restarted with the others: no tick was done for {} ms; messages rejected: {rejected}", limit_ms);
            for process in [Process::Planner, Process::Controller, Process::Standby] {
                if !self.on_lost(process, Detector::Tick, &what)? {
                    return Ok(true);
                }
            }
            return Ok(false);
        }
        if self.run.settings.plant.on_loss == OnLoss::Restart && std::mem::take(&mut self.stall.plant_restart_left) {
            // The plant is next, since all others wait for it.
            let what = format!("has done no tick for {} ms; messages rejected: {rejected}", limit_ms);
            return Ok(!self.on_lost(Process::Plant, Detector::Tick, &what)?);
        }
        self.fault("gate", format!("has published no command for {limit_ms} ms; messages rejected: {rejected}"), Detector::Tick);
        Ok(true)
    }
}
