//! The main thread during a run: starts the processes, watches them with three detectors, starts them again, and ends them.

mod detect;
mod handover_cache;
mod inject;
mod restart;
mod slot;

use crate::children::{self, Child, started};
use crate::notify::Notify;
use crate::privileges::{self, Cores};
use crate::progress::Progress;
use crate::recorder::{self, Recorder};
use crate::request::RunRequest;
use crate::summary::{self, Losses, RunFault};
use anyhow::Result;
use handover_cache::HandOverCache;
use hapfic_config::{PERIOD_S, Settings};
use hapfic_gate_process::shared_status::SharedStatus;
use hapfic_ipc::realtime::{self, SchedGrants};
use hapfic_ipc::{Bus, Doorbell, IpcError, Output, ProcessStart};
use hapfic_messages::{Clock, Detector, Event, EventKind, Phase, Process, RealtimeMode, Severity};
use inject::Injections;
use slot::ProcessSlot;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

pub use inject::{check as check_faults, describe as describe_fault, possible as fault_possible};

/// Priority of the main thread in realtime: below all that tick, and below those who join.
const WATCHING: u32 = 5;
/// How often the supervisor looks at its processes when nothing calls.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// How often while somebody joins, or a fault on purpose is near.
const FAST_POLL_INTERVAL: Duration = Duration::from_millis(1);
/// Ticks before a fault on purpose from which on it looks closely.
const NEAR: i64 = 200;
/// How long processes may take to do their last tick after the gate's.
const LAST_TICK: Duration = Duration::from_secs(1);

/// When a run started and ended.
#[derive(Default)]
pub struct RunTimes {
    /// From the start of the program to the first tick, s.
    pub launch_s: f64,
    /// From the first tick to the last, by the clock on the wall, s.
    pub wall_s: f64,
    /// Time the host took away meanwhile, ms.
    pub steal_ms: u64,
    /// Ticks that the gate's spare has done.
    pub spare_ticks: u64,
    /// Whether the run reached its end.
    pub completed: bool,
}

/// What the main thread starts with.
pub struct WatchStart<'a> {
    /// What was asked for.
    pub request: &'a RunRequest,
    /// Shared with the rest of the supervisor.
    pub shared: Arc<SharedStatus>,
    /// The gate's thread.
    pub gate: JoinHandle<Result<(), IpcError>>,
    /// The recorder.
    pub recorder: &'a Recorder,
    /// Set by signals.
    pub stop: Arc<AtomicBool>,
    /// What the processes need.
    pub run_file: &'a Path,
    /// Cores of the real-time threads.
    pub cores: Cores,
    /// Faults that operators ask for.
    pub asked: std::sync::mpsc::Receiver<hapfic_config::Fault>,
    /// The way to the service manager.
    pub notify: &'a Notify,
}

/// The main thread's view of a run.
pub struct Watch<'a> {
    request: &'a RunRequest,
    settings: &'a Settings,
    clock: Clock,
    shared: Arc<SharedStatus>,
    slots: Vec<ProcessSlot>,
    gate: Option<JoinHandle<Result<(), IpcError>>>,
    recorder: &'a Recorder,
    stop: Arc<AtomicBool>,
    run_file: &'a Path,
    cores: Cores,
    /// Code of the primary controller whose place was given last.
    primary: u32,
    notify: &'a Notify,
    bus: &'a Bus,
    cache: HandOverCache,
    injections: Injections,
    doorbells: Vec<Doorbell>,
    events: Output<Event>,
    begun: Instant,
    /// Re-armings that have been taken in.
    rearms: u64,
    /// Dead processes whose places have not been swept yet.
    not_cleaned_up: u32,
    /// Meetings that gate and recorder could not make so far.
    failed_connections: u32,
    /// Whether a latched stop was asked for because a budget was spent, and not left since.
    stopped_by_budget: bool,
    /// What went wrong so far that the run cannot get over.
    pub faults: Vec<RunFault>,
    /// Since the last tick: whether the plant has not been started anew yet, and whether all the others have.
    spare_the_plant: bool,
    all_started_anew: bool,
    /// Last tick that had been gated, and when that was first seen.
    advanced: (i64, Instant),
}

impl<'a> Watch<'a> {
    /// Opens the main thread's ports; nobody is started yet.
    ///
    /// # Errors
    /// [`IpcError`] if they cannot be had.
    pub fn open(bus: &'a Bus, begin: WatchStart<'a>) -> Result<Self, IpcError> {
        use hapfic_ipc::topic;
        let WatchStart { request, shared, gate, recorder, stop, run_file, cores, asked, notify } = begin;
        Ok(Self {
            request,
            settings: &request.settings,
            clock: request.clock,
            slots: Vec::new(),
            gate: Some(gate),
            recorder,
            stop,
            run_file,
            cores,
            primary: Process::Controller.code(),
            notify,
            bus,
            cache: HandOverCache::open(bus)?,
            injections: Injections::new(&request.settings.faults, asked, bus.output(&topic::INJECTION)?, &request.log),
            doorbells: [
                topic::STATE.doorbell,
                topic::REFERENCE.doorbell,
                topic::REQUEST.doorbell,
                topic::COMMAND.doorbell,
                topic::CREDIT.doorbell,
            ]
            .into_iter()
            .flatten()
            .map(|place| bus.doorbell(place))
            .collect(),
            events: bus.output(&topic::EVENT)?,
            begun: Instant::now(),
            rearms: 0,
            not_cleaned_up: 0,
            failed_connections: 0,
            stopped_by_budget: false,
            faults: Vec::new(),
            spare_the_plant: true,
            all_started_anew: false,
            advanced: (-1, Instant::now()),
            shared,
        })
    }

    /// Starts all processes, waits until they are ready, and follows the run to its end.
    ///
    /// # Errors
    /// If a process cannot be started or polled.
    pub fn start_and_follow(&mut self) -> Result<RunTimes> {
        for process in started(self.settings) {
            let child = Child::start(*process, self.settings, self.run_file, ProcessStart::default())?;
            self.slots.push(ProcessSlot::new(*process, child));
        }
        let ready = self.wait_until_ready()?;
        let begun = Instant::now();
        let launch_s = self.request.since.elapsed().as_secs_f64();
        let stolen = summary::steal_ms();
        let mut completed = false;
        if ready {
            if self.clock == Clock::Realtime && !self.has_what_it_requires() {
                return Ok(RunTimes { launch_s, ..RunTimes::default() });
            }
            if self.clock == Clock::Realtime {
                privileges::report(self.settings, self.request.realtime, self.cores, &self.shared);
            }
            let what = format!("{} ({}) starts", self.request.scenario, self.clock.name());
            self.report(-1, Process::Supervisor, EventKind::Started, Severity::Nominal, Detector::None, &what);
            self.notify.ready();
            self.notify.status(&what);
            self.begun = Instant::now();
            self.advanced = (-1, Instant::now());
            let present = started(self.settings).iter().fold(0, |bits, p| bits | bit(*p));
            self.shared.present.store(present, Ordering::Release);
            for slot in &mut self.slots {
                slot.restart.stage = hapfic_gate::restart::RestartStage::Working;
            }
            self.inject()?;
            if self.clock == Clock::Realtime
                && SchedGrants(self.shared.heartbeat(recorder::GATE).realtime()).has(SchedGrants::FIFO)
            {
                // Who is to start others again must not wait for the rest of the machine. What cannot be had is had without.
                let _ = realtime::set_fifo(WATCHING);
            }
            self.shared.go.store(true, Ordering::Release);
            completed = self.follow()?;
            if completed {
                let last = self.shared.gated.load(Ordering::Relaxed);
                self.report(last, Process::Supervisor, EventKind::Ended, Severity::Nominal, Detector::None, "all ticks are done");
            }
        }
        Ok(RunTimes {
            launch_s,
            wall_s: begun.elapsed().as_secs_f64(),
            steal_ms: summary::steal_ms().saturating_sub(stolen),
            spare_ticks: self.shared.spare_ticks.load(Ordering::Relaxed),
            completed,
        })
    }

    /// Takes note of something that the run cannot get over.
    pub fn fault(&mut self, process: &str, what: String, detector: &'static str) {
        let tick = self.shared.gated.load(Ordering::Relaxed);
        let (kind, seen) = match detector {
            "exit" => (EventKind::Lost, Detector::Exit),
            "heartbeat" => (EventKind::Lost, Detector::Heartbeat),
            "tick" => (EventKind::Lost, Detector::Tick),
            "check" => (EventKind::Lost, Detector::Check),
            "budget" => (EventKind::Lost, Detector::Budget),
            "operator" => (EventKind::Ended, Detector::Operator),
            _ => (EventKind::Ended, Detector::None),
        };
        let about = Process::from_name(process).unwrap_or(Process::Supervisor);
        self.report(tick, about, kind, Severity::Stopped, seen, &format!("{process} {what}"));
        self.faults.push(RunFault { process: process.to_owned(), what, detector, tick });
    }

    /// Into the log. Whoever cannot be told is the recorder, and its own failure is reported elsewhere.
    fn report(&mut self, tick: i64, about: Process, kind: EventKind, severity: Severity, seen: Detector, text: &str) {
        let stamp_ns = if self.clock == Clock::Realtime { hapfic_ipc::clock::now_ns() } else { 0 };
        let _ = self.events.send(&Event { stamp_ns, ..Event::new(tick, about, kind, severity, seen, text) });
    }

    /// An event of now, with the severity there is.
    fn note(&mut self, about: Process, kind: EventKind, seen: Detector, text: &str) {
        let severity = Severity::from_code(self.shared.severity.load(Ordering::Relaxed)).unwrap_or(Severity::Nominal);
        self.report(self.shared.gated.load(Ordering::Relaxed), about, kind, severity, seen, text);
    }

    /// Waits until all have said that they are ready. `false` if one does not get there.
    fn wait_until_ready(&mut self) -> Result<bool> {
        let deadline = Instant::now() + Duration::from_millis(self.settings.supervisor.ready_timeout_ms.into());
        loop {
            if !self.healthy()? {
                return Ok(false);
            }
            let missing: Vec<_> = started(self.settings)
                .iter()
                .chain([&recorder::GATE])
                .filter(|p| self.shared.heartbeat(**p).phase().is_none())
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
            self.pause(FAST_POLL_INTERVAL);
        }
    }

    /// Follows the run to its end. Whether it got there.
    fn follow(&mut self) -> Result<bool> {
        let mut progress = Progress::new(self.settings.duration_ticks as f64 * PERIOD_S);
        loop {
            if self.shared.gated.load(Ordering::Acquire) + 1 >= self.settings.duration_ticks as i64 {
                progress.clear();
                let stopped = self.shared.severity.load(Ordering::Relaxed) == Severity::Stopped.code();
                if stopped && !self.stopped_by_budget {
                    self.fault("supervisor", "was in a latched stop when the run ended".to_owned(), "operator");
                }
                return Ok(true);
            }
            if !self.healthy()? {
                progress.clear();
                return Ok(false);
            }
            if let Ok(snapshot) = self.shared.snapshot.lock() {
                progress.show(&snapshot);
            }
            self.notify.watchdog();
            let joining = self.slots.iter().any(ProcessSlot::joining);
            if joining {
                self.cache.preloan();
                for doorbell in &self.doorbells {
                    doorbell.notify();
                }
            }
            let near = joining || self.injections.near(self.shared.gated.load(Ordering::Relaxed), NEAR);
            self.pause(if near { FAST_POLL_INTERVAL } else { POLL_INTERVAL });
        }
    }

    /// Waits until a process ends, or for so long.
    fn pause(&self, time: Duration) {
        children::watch(self.slots.iter().filter_map(|s| s.child.as_ref()), time);
    }

    /// Does the faults that are due.
    fn inject(&mut self) -> Result<()> {
        let gated = self.shared.gated.load(Ordering::Acquire);
        for (fault, what) in self.injections.act(&mut self.slots, &self.shared, gated)? {
            let about = Process::from_name(fault.target.name()).unwrap_or(Process::Supervisor);
            self.note(about, EventKind::Injected, Detector::None, &format!("fault on purpose: {what}"));
        }
        Ok(())
    }

    /// With `--realtime require`: whether every thread has got what it asked for.
    fn has_what_it_requires(&mut self) -> bool {
        if self.request.realtime != RealtimeMode::Require {
            return true;
        }
        let missing = privileges::missing(self.settings, self.cores, &self.shared);
        for (process, what) in &missing {
            self.fault(process, format!("did not get {what}, which --realtime require asks for"), "start");
        }
        missing.is_empty()
    }

    /// What the run got over.
    #[must_use]
    pub fn losses(&self) -> Losses {
        Losses::new(self.slots.iter().map(|s| (s.process, s.losses, s.longest)), self.injections.done)
    }

    /// Ends everyone, then lets the recorder take in what is left.
    ///
    /// # Errors
    /// If the system does not tell how one ended.
    pub fn end(&mut self, completed: bool) -> Result<()> {
        self.notify.stopping();
        if completed {
            // Controllers whose request was not needed for the last tick still send it.
            let asked = Instant::now();
            let done = |s: &ProcessSlot| s.child.is_none() || self.shared.heartbeat(s.process).phase() == Some(Phase::Finished);
            while !self.slots.iter().all(done) && asked.elapsed() < LAST_TICK {
                self.pause(FAST_POLL_INTERVAL);
            }
        }
        self.shared.stop.store(true, Ordering::Release);
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
            let seen = self.shared.rounds();
            while self.shared.rounds() < seen + 2 && asked.elapsed() < LAST_TICK {
                self.pause(FAST_POLL_INTERVAL);
            }
        }
        let children: Vec<Child> = self.slots.iter_mut().filter_map(|s| s.child.take()).collect();
        for process in children::end(children)? {
            self.fault(process.name(), "did not end when asked to, and was killed".to_owned(), "exit");
        }
        self.shared.drain.store(true, Ordering::Release);
        Ok(())
    }
}

impl Drop for Watch<'_> {
    fn drop(&mut self) {
        // Nothing to report to: whoever cared has called `end`.
        let _ = children::end(self.slots.iter_mut().filter_map(|s| s.child.take()).collect());
    }
}

/// A process's place in a set of processes.
fn bit(process: Process) -> u32 {
    1 << process.code()
}
