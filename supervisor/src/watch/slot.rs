//! The slot of a process in a run: the process, the state of its restart, and the detectors.

use crate::children::{Child, describe};
use anyhow::Result;
use hapfic_gate::restart::{RestartStage, RestartState};
use hapfic_gate_process::shared_status::SharedStatus;
use hapfic_messages::{Detector, Phase, Process};
use std::time::{Duration, Instant};

/// Limits of the detectors.
#[derive(Clone, Copy, Debug)]
pub struct DetectorLimits {
    /// Time from the start of a process to its first tick.
    pub ready: Duration,
    /// Heartbeat age [ns].
    pub silence_ns: u64,
    /// Ticks of the others during which a process may do none; `None`: the clock waits for it.
    pub behind: Option<i64>,
}

/// Slot of a process, kept over its restarts.
#[derive(Debug)]
pub struct ProcessSlot {
    /// Role of the process.
    pub process: Process,
    /// Current process, if there is one.
    pub child: Option<Child>,
    /// State of the restart.
    pub restart: RestartState,
    /// Number of the start.
    pub generation: u32,
    /// Start of the current process.
    pub started: Instant,
    /// Time at which the loss of its predecessor was detected.
    pub lost: Option<Instant>,
    /// Losses so far.
    pub losses: u32,
    /// Longest time from a loss to the successor's first tick.
    pub longest: Duration,
    /// Whether an injected fault has killed the current process and no detector has seen it yet.
    pub kill_pending: bool,
    /// Failed connections of the current process.
    pub failed_connections: u32,
    /// Rejected messages already reported.
    pub rejected: u32,
}

impl ProcessSlot {
    /// Makes the slot of a process in its first start.
    #[must_use]
    pub fn new(process: Process, child: Child) -> Self {
        Self {
            process,
            child: Some(child),
            restart: RestartState::default(),
            generation: 0,
            started: Instant::now(),
            lost: None,
            losses: 0,
            longest: Duration::ZERO,
            kill_pending: false,
            failed_connections: 0,
            rejected: 0,
        }
    }

    /// Whether a process is restarting, or waits for its restart.
    #[must_use]
    pub fn joining(&self) -> bool {
        self.generation > 0 && matches!(self.restart.stage, RestartStage::Starting)
            || matches!(self.restart.stage, RestartStage::BackOff(_))
    }

    /// Whether the process does ticks.
    #[must_use]
    pub fn ticks(&self, shared: &SharedStatus) -> bool {
        self.child.is_some() && matches!(shared.heartbeat(self.process).phase(), Some(Phase::Running | Phase::Finished))
    }

    /// Runs the detectors; returns the first that finds the process lost, and a description.
    ///
    /// Exit, heartbeat and tick detector are independent of each other; a fourth check covers the start.
    ///
    /// # Errors
    /// If the system does not report the process's state.
    pub fn check(&mut self, shared: &SharedStatus, limits: &DetectorLimits) -> Result<Option<(Detector, String)>> {
        let Some(child) = &mut self.child else { return Ok(None) };
        if let Some(status) = child.ended()? {
            return Ok(Some((Detector::Exit, describe(status))));
        }
        let heartbeat = shared.heartbeat(self.process);
        let phase = heartbeat.phase();
        if phase == Some(Phase::Finished) {
            return Ok(None);
        }
        if let Some(age) = shared.silence_ns(self.process)
            && age > limits.silence_ns
        {
            return Ok(Some((Detector::Heartbeat, format!("has sent no heartbeat for {} ms", age / 1_000_000))));
        }
        if self.restart.stage == RestartStage::Starting && self.generation > 0 && self.started.elapsed() > limits.ready {
            let what = if phase.is_none() { "did not get ready in time" } else { "got ready and did no tick in time" };
            return Ok(Some((Detector::Tick, what.to_owned())));
        }
        let gated = shared.gated.load(std::sync::atomic::Ordering::Acquire);
        if let Some(limit) = limits.behind
            && self.restart.stage == RestartStage::Working
            && self.process != Process::Plant
            && gated - heartbeat.tick() > limit
        {
            return Ok(Some((Detector::Tick, format!("is alive and has done no tick since tick {}", heartbeat.tick()))));
        }
        Ok(None)
    }
}
