//! The slot of a process in a run: the process, the state of its restart, and the detectors.

use super::evidence::{Evidence, Suspicion};
use crate::children::Child;
use anyhow::Result;
use hapfic_gate::restart_policy::{RestartStage, RestartState};
use hapfic_ipc::{ProcessRecord, SharedStatus};
use hapfic_messages::{Detector, PERIOD_NS, Phase, Process};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Limits of the detectors.
#[derive(Clone, Copy, Debug)]
pub struct DetectorLimits {
    /// Observed time from the start of a process to its first tick [ns].
    pub ready_ns: u64,
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
    /// Current process, if any.
    pub child: Option<Child>,
    /// State of the restart.
    pub restart: RestartState,
    /// Number of the start.
    pub generation: u32,
    /// Observed time at the start of the current process [ns].
    pub started_observed_ns: u64,
    /// Suspicion of the current process.
    pub suspicion: Option<Suspicion>,
    /// Time at which the loss of its predecessor was detected.
    pub lost: Option<Instant>,
    /// Losses so far.
    pub losses: u32,
    /// Longest time from a loss to the successor's first tick.
    pub longest: Duration,
    /// Whether an injected fault has killed the current process, undetected so far.
    pub kill_pending: bool,
    /// Failed connections of the current process.
    pub failed_connections: u32,
    /// Rejected messages already reported.
    pub rejected: u32,
}

impl ProcessSlot {
    /// Creates the slot of a process in its first start.
    #[must_use]
    pub fn new(process: Process, child: Child) -> Self {
        Self { child: Some(child), ..Self::without_child(process) }
    }

    fn without_child(process: Process) -> Self {
        Self {
            process,
            child: None,
            restart: RestartState::default(),
            generation: 0,
            started_observed_ns: 0,
            suspicion: None,
            lost: None,
            losses: 0,
            longest: Duration::ZERO,
            kill_pending: false,
            failed_connections: 0,
            rejected: 0,
        }
    }

    /// Creates the slot of a process that a lost supervisor has watched. `child` is the process if it still runs, `present`
    /// whether it did ticks.
    #[must_use]
    pub fn taken_over(
        process: Process,
        child: Option<Child>,
        record: &ProcessRecord,
        shared: &SharedStatus,
        present: bool,
    ) -> Self {
        let heartbeat = shared.heartbeats.read(process);
        let stage = match () {
            () if record.given_up.load(Ordering::Relaxed) != 0 => RestartStage::BudgetSpent,
            () if present => RestartStage::Working,
            () if child.is_some() || record.pid().is_some() => RestartStage::Starting,
            // The lost supervisor knew that it was lost.
            () => RestartStage::BackOff(0),
        };
        let lost = (!present).then(Instant::now);
        Self {
            child,
            restart: RestartState::at(stage),
            generation: record.generation.load(Ordering::Relaxed),
            lost,
            losses: record.losses.load(Ordering::Relaxed),
            longest: Duration::from_nanos(record.longest_ns.load(Ordering::Relaxed)),
            // Known already. Of failed connections nobody knows whether they are repaired.
            rejected: heartbeat.rejected,
            ..Self::without_child(process)
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
        self.child.is_some() && matches!(shared.heartbeats.read(self.process).phase, Some(Phase::Running | Phase::Finished))
    }

    /// Runs the detectors; returns the first detector that finds the process lost, and a description.
    ///
    /// Exit, heartbeat and tick detector are independent of each other; a fourth check covers the start. None of them counts
    /// time in which the supervisor did not observe the process, or in which the process waited for a processor.
    ///
    /// # Errors
    /// If the system does not report the process's state.
    pub fn check(
        &mut self,
        shared: &SharedStatus,
        evidence: &Evidence,
        limits: &DetectorLimits,
    ) -> Result<Option<(Detector, String)>> {
        let Some(child) = &mut self.child else { return Ok(None) };
        if let Some(end) = child.ended()? {
            return Ok(Some((Detector::Exit, end.to_string())));
        }
        let heartbeat = shared.heartbeats.read(self.process);
        if heartbeat.phase == Some(Phase::Finished) {
            return Ok(None);
        }
        let pid = child.pid();
        let gated = shared.gate.tick.load(Ordering::Acquire);
        let silence_ns = evidence.silence_ns(self.process).unwrap_or(0);
        let starting = self.restart.stage == RestartStage::Starting && self.generation > 0;
        let starting_ns = if starting { evidence.observed_ns() - self.started_observed_ns } else { 0 };
        let ticking = self.restart.stage == RestartStage::Working
            && !matches!(self.process, Process::Plant | Process::Gate | Process::SpareGate | Process::Recorder);
        let behind = if ticking { gated.saturating_sub(heartbeat.tick) } else { 0 };
        let behind_limit = limits.behind.unwrap_or(i64::MAX);
        if silence_ns <= limits.silence_ns / 2 && behind <= behind_limit / 2 && starting_ns <= limits.ready_ns / 2 {
            self.suspicion = None;
            return Ok(None);
        }
        let suspicion = self.suspicion.get_or_insert_with(|| Suspicion::begin(pid, evidence));
        let (detector, what, limit_ns) = if silence_ns > limits.silence_ns {
            let age_ms = heartbeat.age_ns().unwrap_or(0) / 1_000_000;
            (Detector::Heartbeat, format!("has sent no heartbeat for {age_ms} ms"), limits.silence_ns)
        } else if starting_ns > limits.ready_ns {
            let what = if heartbeat.phase.is_none() { "did not get ready in time" } else { "got ready and did no tick in time" };
            (Detector::Tick, what.to_owned(), limits.ready_ns)
        } else if behind > behind_limit {
            let what = format!("is alive, but has completed no tick since tick {}", heartbeat.tick);
            (Detector::Tick, what, behind_limit as u64 * PERIOD_NS)
        } else {
            return Ok(None);
        };
        // Also after an excuse, and if the first look is already beyond the limit, the evidence takes its time.
        if suspicion.observed_ns(evidence) < limit_ns / 4 || suspicion.excuse(evidence) {
            return Ok(None);
        }
        let observed_ms = suspicion.observed_ns(evidence) / 1_000_000;
        let delay_ms = evidence.largest_delay().as_secs_f64() * 1e3;
        let what = format!("{what} (under suspicion for {observed_ms} ms; largest delay of the supervisor {delay_ms:.0} ms)");
        Ok(Some((detector, what)))
    }
}
