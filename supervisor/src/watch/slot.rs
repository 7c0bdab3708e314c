//! A process's place in a run: the process in it, its restart, and the detectors that look at it.

use crate::children::{Child, describe};
use anyhow::Result;
use hapfic_gate::restart::{RestartStage, RestartState};
use hapfic_gate_process::shared_status::SharedStatus;
use hapfic_messages::{Detector, Phase, Process};
use std::time::{Duration, Instant};

/// The detectors' limits.
#[derive(Clone, Copy, Debug)]
pub struct DetectorLimits {
    /// How long a process may take to get ready, and from there to its first tick.
    pub ready: Duration,
    /// Age of the last signal of restart, ns.
    pub silence_ns: u64,
    /// Ticks that others may do while it does none; `None`: the clock waits for it.
    pub behind: Option<i64>,
}

/// A process's place.
#[derive(Debug)]
pub struct ProcessSlot {
    /// Which process.
    pub process: Process,
    /// The one that is there.
    pub child: Option<Child>,
    /// Where it stands.
    pub restart: RestartState,
    /// Number of the start.
    pub generation: u32,
    /// When the present process was started.
    pub started: Instant,
    /// When its forerunner was found lost.
    pub lost: Option<Instant>,
    /// Losses so far.
    pub losses: u32,
    /// Longest time from a loss to the successor's first tick.
    pub longest: Duration,
    /// Whether the present process has been killed on purpose and its end not been seen yet.
    pub kill_pending: bool,
    /// Meetings that the present process could not make.
    pub failed_connections: u32,
    /// Refused messages that have been told of.
    pub rejected: u32,
}

impl ProcessSlot {
    /// A place whose process is about to be started for the first time.
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

    /// Whether a process is being started again, or is about to be.
    #[must_use]
    pub fn joining(&self) -> bool {
        self.generation > 0 && matches!(self.restart.stage, RestartStage::Starting)
            || matches!(self.restart.stage, RestartStage::BackOff(_))
    }

    /// Whether its process does ticks.
    #[must_use]
    pub fn ticks(&self, shared: &SharedStatus) -> bool {
        self.child.is_some() && matches!(shared.heartbeat(self.process).phase(), Some(Phase::Running | Phase::Finished))
    }

    /// Whether its process is lost: what happened, and which detector saw it. Three detectors look independently of each other,
    /// and a fourth at the start.
    ///
    /// # Errors
    /// If the system does not tell.
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
            return Ok(Some((Detector::Heartbeat, format!("has not been heard of for {} ms", age / 1_000_000))));
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
