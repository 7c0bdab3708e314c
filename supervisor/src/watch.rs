//! The main thread during a run: starts the processes, watches them with three detectors, and ends them.

use crate::children::{Child, Children, describe};
use crate::launch::Request;
use crate::live::Live;
use crate::privileges;
use crate::progress::Progress;
use crate::recorder::{self, Recorder};
use crate::summary::{self, Fault};
use anyhow::Result;
use hapfic_config::{PERIOD_S, Settings};
use hapfic_ipc::message::{Detector, Event, EventKind, Phase, Process, Severity};
use hapfic_ipc::{Clock, IpcError, Output, RealtimeMode};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How often the supervisor looks at its processes when nothing calls.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// In lockstep nothing is lost while a process stands still, so a busy host gets so many times as long.
const LOCKSTEP_PATIENCE: u64 = 5;
/// Processes started, in this order.
pub const STARTED: [Process; 3] = [Process::Plant, Process::Planner, Process::Controller];

/// When a run started and ended.
#[derive(Default)]
pub struct Timed {
    /// From the start of the program to the first tick, s.
    pub launch_s: f64,
    /// From the first tick to the last, by the clock on the wall, s.
    pub wall_s: f64,
    /// Time the host took away meanwhile, ms.
    pub steal_ms: u64,
    /// Whether the run reached its end.
    pub completed: bool,
}

/// The main thread's view of a run.
pub struct Watch<'a> {
    pub clock: Clock,
    pub settings: &'a Settings,
    pub live: Arc<Live>,
    pub children: Children,
    pub gate: Option<JoinHandle<Result<(), IpcError>>>,
    pub recorder: &'a Recorder,
    pub stop: Arc<AtomicBool>,
    pub faults: Vec<Fault>,
    pub events: Output<Event>,
    /// Last tick that had been gated, and when that was first seen.
    pub advanced: (i64, Instant),
}

impl Watch<'_> {
    /// Starts all processes, waits until they are ready, and follows the run to its end.
    ///
    /// # Errors
    /// If a process cannot be started or watched.
    pub fn start_and_follow(&mut self, request: &Request, run_file: &Path, core: Option<u32>) -> Result<Timed> {
        for process in STARTED {
            self.children.0.push(Child::start(process, self.settings, run_file)?);
        }
        let ready = self.wait_until_ready()?;
        let started = Instant::now();
        let launch_s = request.since.elapsed().as_secs_f64();
        let stolen = summary::steal_ms();
        let mut completed = false;
        if ready {
            if request.clock == Clock::Realtime && !self.has_what_it_requires(request, core) {
                return Ok(Timed { launch_s, ..Timed::default() });
            }
            if request.clock == Clock::Realtime {
                privileges::report(self.settings, request.realtime, core, &self.live);
            }
            let what = format!("{} ({}) starts", request.scenario, request.clock.name());
            self.tell(-1, Process::Supervisor, EventKind::Started, Severity::Nominal, Detector::None, &what);
            self.advanced = (-1, Instant::now());
            self.live.go.store(true, Ordering::Release);
            completed = self.follow()?;
            if completed {
                let last = self.live.gated.load(Ordering::Relaxed);
                self.tell(last, Process::Supervisor, EventKind::Ended, Severity::Nominal, Detector::None, "all ticks are done");
            }
        }
        Ok(Timed {
            launch_s,
            wall_s: started.elapsed().as_secs_f64(),
            steal_ms: summary::steal_ms().saturating_sub(stolen),
            completed,
        })
    }

    /// Takes note of something that went wrong.
    pub fn fault(&mut self, process: &str, what: String, detector: &'static str) {
        let tick = self.live.gated.load(Ordering::Relaxed);
        let (kind, seen) = match detector {
            "exit" => (EventKind::Lost, Detector::Exit),
            "heartbeat" => (EventKind::Lost, Detector::Heartbeat),
            "tick" => (EventKind::Lost, Detector::Tick),
            _ => (EventKind::Ended, Detector::None),
        };
        let about = Process::from_name(process).unwrap_or(Process::Supervisor);
        self.tell(tick, about, kind, Severity::Stopped, seen, &format!("{process} {what}"));
        self.faults.push(Fault { process: process.to_owned(), what, detector, tick });
    }

    /// Into the log. Whoever cannot be told is the recorder, and its own failure is reported elsewhere.
    fn tell(&mut self, tick: i64, about: Process, kind: EventKind, severity: Severity, seen: Detector, text: &str) {
        let _ = self.events.send(&Event::new(tick, about, kind, severity, seen, text));
    }

    /// Waits until all have said that they are ready. `false` if one does not get there.
    fn wait_until_ready(&mut self) -> Result<bool> {
        let deadline = Instant::now() + Duration::from_millis(self.settings.supervisor.ready_timeout_ms.into());
        loop {
            if !self.all_well()? {
                return Ok(false);
            }
            let missing: Vec<_> = STARTED
                .iter()
                .chain([&recorder::GATE])
                .filter(|p| self.live.pulse(**p).phase().is_none())
                .map(|p| p.name())
                .collect();
            if missing.is_empty() {
                return Ok(true);
            }
            if Instant::now() > deadline {
                for process in missing {
                    self.fault(process, "did not get ready in time".to_owned(), "start");
                }
                return Ok(false);
            }
            self.children.watch(Duration::from_millis(1));
        }
    }

    /// Follows the run to its end. Whether it got there.
    fn follow(&mut self) -> Result<bool> {
        let mut progress = Progress::new(self.settings.duration_ticks as f64 * PERIOD_S);
        loop {
            let gated = self.gate.as_ref().is_none_or(JoinHandle::is_finished);
            if gated && self.live.gated.load(Ordering::Acquire) + 1 >= self.settings.duration_ticks as i64 {
                progress.clear();
                return Ok(true);
            }
            if !self.all_well()? {
                progress.clear();
                return Ok(false);
            }
            if let Ok(glance) = self.live.glance.lock() {
                progress.show(&glance);
            }
            self.children.watch(LOOK_EVERY);
        }
    }

    /// Looks at everyone. `false` if the run has to end.
    fn all_well(&mut self) -> Result<bool> {
        if self.live.asked_to_stop.load(Ordering::Relaxed) {
            self.fault("supervisor", "was asked to end by the operator".to_owned(), "operator");
            return Ok(false);
        }
        if self.stop.load(Ordering::Relaxed) {
            self.fault("supervisor", "was asked to end by a signal".to_owned(), "signal");
            return Ok(false);
        }
        let mut lost = Vec::new();
        for child in &mut self.children.0 {
            if let Some(status) = child.ended()? {
                lost.push((child.process, describe(status), "exit"));
            }
        }
        let patience = if self.clock == Clock::Lockstep { LOCKSTEP_PATIENCE } else { 1 };
        let limit = u64::from(self.settings.supervisor.heartbeat_timeout_ms) * patience * 1_000_000;
        for process in STARTED.iter().chain([&recorder::GATE]) {
            if let Some(age) = self.live.silence_ns(*process)
                && age > limit
                && self.live.pulse(*process).phase() != Some(Phase::Finished)
                && !lost.iter().any(|(p, _, _)| p == process)
            {
                lost.push((*process, format!("has not been heard of for {} ms", age / 1_000_000), "heartbeat"));
            }
        }
        for (process, what, detector) in &lost {
            let name = if *process == recorder::GATE { "gate" } else { process.name() };
            self.fault(name, what.clone(), detector);
        }
        if self.live.go.load(Ordering::Relaxed) && lost.is_empty() && self.stalled() {
            return Ok(false);
        }
        if self.live.log_failed.load(Ordering::Acquire) || self.recorder.failed() {
            self.fault("recorder", "cannot write the log any further".to_owned(), "recorder");
            return Ok(false);
        }
        if lost.is_empty() && self.gate.as_ref().is_some_and(JoinHandle::is_finished) {
            let done = self.live.gated.load(Ordering::Acquire) + 1 >= self.settings.duration_ticks as i64;
            if !done {
                self.fault("gate", "ended too early".to_owned(), "exit");
                return Ok(false);
            }
        }
        Ok(lost.is_empty())
    }

    /// The third detector: everybody lives, and no tick is done.
    fn stalled(&mut self) -> bool {
        let gated = self.live.gated.load(Ordering::Acquire);
        if gated != self.advanced.0 || gated + 1 >= self.settings.duration_ticks as i64 {
            self.advanced = (gated, Instant::now());
            return false;
        }
        let limit = Duration::from_millis(self.settings.supervisor.stall_timeout_ms.into());
        let stalled = self.advanced.1.elapsed() > limit;
        if stalled {
            let refused: Vec<_> = STARTED
                .iter()
                .chain([&recorder::GATE])
                .filter(|p| self.live.pulse(**p).refused() > 0)
                .map(|p| format!("{p} {}", self.live.pulse(*p).refused()))
                .collect();
            let refused = if refused.is_empty() { "none".to_owned() } else { refused.join(", ") };
            self.fault(
                "gate",
                format!("has had nothing to pass on for {} ms; messages refused: {refused}", limit.as_millis()),
                "tick",
            );
        }
        stalled
    }

    /// With `--realtime require`: whether every thread has got what it asked for.
    fn has_what_it_requires(&mut self, request: &Request, core: Option<u32>) -> bool {
        if request.realtime != RealtimeMode::Require {
            return true;
        }
        let missing = privileges::missing(self.settings, core, &self.live);
        for (process, what) in &missing {
            self.fault(process, format!("did not get {what}, which --realtime require asks for"), "start");
        }
        missing.is_empty()
    }

    /// Ends everyone, then lets the recorder take in what is left.
    pub fn end(&mut self, completed: bool) -> Result<()> {
        self.live.stop.store(true, Ordering::Release);
        if let Some(gate) = self.gate.take() {
            match gate.join() {
                Ok(Ok(())) => {}
                Ok(Err(e)) => self.fault("gate", e.to_string(), "exit"),
                Err(_) => self.fault("gate", "panicked".to_owned(), "exit"),
            }
        }
        if completed {
            // What they published last is still theirs: let the recorder have it before they go.
            let asked = Instant::now();
            let seen = self.live.rounds();
            while self.live.rounds() < seen + 2 && asked.elapsed() < Duration::from_secs(1) {
                self.children.watch(Duration::from_millis(1));
            }
        }
        for process in self.children.end()? {
            self.fault(process.name(), "did not end when asked to, and was killed".to_owned(), "exit");
        }
        self.live.drain.store(true, Ordering::Release);
        Ok(())
    }
}
