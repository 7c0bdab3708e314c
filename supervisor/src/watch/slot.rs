//! A process's place in a run: the process in it, its life, and the detectors that look at it.

use crate::children::{Child, describe};
use anyhow::Result;
use hapfic_gate::restart::{Life, Stage};
use hapfic_gate_process::shared_status::Live;
use hapfic_messages::{Detector, Phase, Process};
use std::time::{Duration, Instant};

/// The detectors' limits.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// How long a process may take to get ready, and from there to its first tick.
    pub ready: Duration,
    /// Age of the last sign of life, ns.
    pub silence_ns: u64,
    /// Ticks that others may do while it does none; `None`: the clock waits for it.
    pub behind: Option<i64>,
}

/// A process's place.
#[derive(Debug)]
pub struct Slot {
    /// Which process.
    pub process: Process,
    /// The one that is there.
    pub child: Option<Child>,
    /// Where it stands.
    pub life: Life,
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
    pub doomed: bool,
    /// Meetings that the present process could not make.
    pub unmet: u32,
    /// Refused messages that have been told of.
    pub refused: u32,
}

impl Slot {
    /// A place whose process is about to be started for the first time.
    #[must_use]
    pub fn new(process: Process, child: Child) -> Self {
        Self {
            process,
            child: Some(child),
            life: Life::default(),
            generation: 0,
            started: Instant::now(),
            lost: None,
            losses: 0,
            longest: Duration::ZERO,
            doomed: false,
            unmet: 0,
            refused: 0,
        }
    }

    /// Whether a process is being started again, or is about to be.
    #[must_use]
    pub fn joining(&self) -> bool {
        self.generation > 0 && matches!(self.life.stage, Stage::Starting) || matches!(self.life.stage, Stage::Due(_))
    }

    /// Whether its process does ticks.
    #[must_use]
    pub fn ticks(&self, live: &Live) -> bool {
        self.child.is_some() && matches!(live.pulse(self.process).phase(), Some(Phase::Running | Phase::Finished))
    }

    /// Whether its process is lost: what happened, and which detector saw it. Three detectors look independently of each other,
    /// and a fourth at the start.
    ///
    /// # Errors
    /// If the system does not tell.
    pub fn look(&mut self, live: &Live, limits: &Limits) -> Result<Option<(Detector, String)>> {
        let Some(child) = &mut self.child else { return Ok(None) };
        if let Some(status) = child.ended()? {
            return Ok(Some((Detector::Exit, describe(status))));
        }
        let pulse = live.pulse(self.process);
        let phase = pulse.phase();
        if phase == Some(Phase::Finished) {
            return Ok(None);
        }
        if let Some(age) = live.silence_ns(self.process)
            && age > limits.silence_ns
        {
            return Ok(Some((Detector::Heartbeat, format!("has not been heard of for {} ms", age / 1_000_000))));
        }
        if self.life.stage == Stage::Starting && self.generation > 0 && self.started.elapsed() > limits.ready {
            let what = if phase.is_none() { "did not get ready in time" } else { "got ready and did no tick in time" };
            return Ok(Some((Detector::Tick, what.to_owned())));
        }
        let gated = live.gated.load(std::sync::atomic::Ordering::Acquire);
        if let Some(limit) = limits.behind
            && self.life.stage == Stage::Working
            && self.process != Process::Plant
            && gated - pulse.tick() > limit
        {
            return Ok(Some((Detector::Tick, format!("is alive and has done no tick since tick {}", pulse.tick()))));
        }
        Ok(None)
    }
}
