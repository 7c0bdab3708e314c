//! The main thread during a run: starts, watches, restarts and ends the processes.

mod clean_up;
mod detect;
mod evidence;
mod handover_cache;
mod inject;
mod restart;
mod slot;

use crate::children::{self, Child, started};
use crate::notify::Notify;
use crate::preflight;
use crate::privileges::{self, Cores};
use crate::progress::Progress;
use crate::recorder::{self, Recorder};
use crate::request::RunRequest;
use crate::summary::{self, Losses, RunFault};
use anyhow::Result;
use clean_up::{CleanUp, SegmentRemover};
use evidence::{Evidence, Suspicion};
use handover_cache::HandOverCache;
use hapfic_config::{PERIOD_S, Settings};
use hapfic_gate_process::status::SharedStatus;
use hapfic_ipc::realtime::{self, SchedGrants};
use hapfic_ipc::{Bus, Doorbell, IpcError, Output, ProcessStart};
use hapfic_messages::{Clock, Detector, Event, EventKind, Phase, Process, RealtimeMode, Severity};
use inject::Injections;
use rustix::process::Pid;
use slot::ProcessSlot;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

pub use inject::{check as check_faults, describe as describe_fault, possible as fault_possible};

/// Priority of the main thread in realtime: below all ticking and all starting processes.
const WATCH_PRIORITY: u32 = 5;
/// Interval at which the supervisor polls its processes.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// The same while a process starts, or an injected fault is near.
const FAST_POLL_INTERVAL: Duration = Duration::from_millis(1);
/// Ticks before an injected fault in which the supervisor polls fast.
const NEAR_TICKS: i64 = 200;
/// Time that processes may take for their last tick after the gate's.
const LAST_TICK_TIMEOUT: Duration = Duration::from_secs(1);

/// Times of a run, and whether it completed.
#[derive(Default)]
pub struct RunTimes {
    /// Time from the start of the program to the first tick [s].
    pub launch_s: f64,
    /// Wall-clock time from the first to the last tick [s].
    pub wall_s: f64,
    /// Steal time during the run [ms].
    pub steal_ms: u64,
    /// Whether the run reached its end.
    pub completed: bool,
}

/// Arguments of [`Watch::open`].
pub struct WatchStart<'a> {
    /// Request of the run.
    pub request: &'a RunRequest,
    /// Status shared with the other threads of the supervisor.
    pub shared: Arc<SharedStatus>,
    /// Thread of the gate.
    pub gate: JoinHandle<Result<(), IpcError>>,
    /// Recorder of the run.
    pub recorder: &'a Recorder,
    /// Flag that signals set to end the run.
    pub stop: Arc<AtomicBool>,
    /// Prefix of the run's segments in shared memory.
    pub prefix: String,
    /// Path of the run file, which the processes read.
    pub run_file: &'a Path,
    /// Cores of the real-time threads.
    pub cores: Cores,
    /// Faults that operators request.
    pub fault_requests: std::sync::mpsc::Receiver<hapfic_config::Fault>,
    /// Connection to the service manager.
    pub notify: &'a Notify,
}

/// The main thread's view of a run.
pub struct Watch<'a> {
    request: &'a RunRequest,
    settings: &'a Settings,
    clock: Clock,
    shared: Arc<SharedStatus>,
    slots: Vec<ProcessSlot>,
    /// Killed processes that have not ended: frozen, or inside an uninterruptible system call.
    abandoned: Vec<Child>,
    gate: Option<JoinHandle<Result<(), IpcError>>>,
    recorder: &'a Recorder,
    stop: Arc<AtomicBool>,
    /// Prefix of the run's segments in shared memory.
    prefix: String,
    run_file: &'a Path,
    cores: Cores,
    /// Code of the primary controller that got its priority and core last.
    primary: u32,
    notify: &'a Notify,
    bus: &'a Bus,
    cache: HandOverCache,
    injections: Injections,
    doorbells: Vec<Doorbell>,
    events: Output<Event>,
    begun: Instant,
    /// Re-armings handled so far.
    rearms: u64,
    /// Dead processes whose nodes are not cleaned up yet.
    not_cleaned_up: u32,
    clean_up: CleanUp,
    segments: SegmentRemover,
    /// Whether all ports reconnect after the clean-up.
    reconnect_due: bool,
    /// Failed connections of gate and recorder so far.
    failed_connections: u32,
    /// Whether a spent budget requested a latched stop, and no re-arming followed.
    stopped_by_budget: bool,
    /// Faults so far that the run does not survive.
    pub faults: Vec<RunFault>,
    /// Since the last tick: whether the plant may still be restarted, and whether all others have been.
    plant_restart_left: bool,
    all_restarted: bool,
    evidence: Evidence,
    /// Last gated tick, and the observed time at which it was new [ns].
    advanced: (i64, u64),
    /// Suspicions of all processes, if no tick was done for half of the time-out.
    stall_suspicions: Vec<(Pid, Suspicion)>,
}

impl<'a> Watch<'a> {
    /// Opens the main thread's ports, before any process starts.
    ///
    /// # Errors
    /// If the ports cannot be opened, or a thread cannot be started.
    pub fn open(bus: &'a Bus, start: WatchStart<'a>) -> Result<Self> {
        use hapfic_ipc::topic;
        let WatchStart { request, shared, gate, recorder, stop, prefix, run_file, cores, fault_requests, notify } = start;
        let segments = SegmentRemover::start(prefix.clone())?;
        Ok(Self {
            request,
            settings: &request.settings,
            clock: request.clock,
            slots: Vec::new(),
            abandoned: Vec::new(),
            gate: Some(gate),
            recorder,
            stop,
            prefix,
            run_file,
            cores,
            primary: Process::Controller.code(),
            notify,
            bus,
            cache: HandOverCache::open(bus)?,
            injections: Injections::new(&request.settings.faults, fault_requests, bus.output(&topic::INJECTION)?, &request.log),
            doorbells: [
                topic::STATE.doorbell,
                topic::REFERENCE.doorbell,
                topic::REQUEST.doorbell,
                topic::COMMAND.doorbell,
                topic::CREDIT.doorbell,
            ]
            .into_iter()
            .flatten()
            .map(|index| bus.doorbell(index))
            .collect(),
            events: bus.output(&topic::EVENT)?,
            begun: Instant::now(),
            rearms: 0,
            not_cleaned_up: 0,
            clean_up: CleanUp::default(),
            segments,
            reconnect_due: false,
            failed_connections: 0,
            stopped_by_budget: false,
            faults: Vec::new(),
            plant_restart_left: true,
            all_restarted: false,
            evidence: Evidence::default(),
            advanced: (-1, 0),
            stall_suspicions: Vec::new(),
            shared,
        })
    }

    /// Starts all processes, waits until they are ready, and watches the run to its end.
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
        let steal_before_ms = summary::steal_ms();
        let mut completed = false;
        if ready {
            preflight::reserve_segments(&self.prefix)?;
            if self.clock == Clock::Realtime && !self.has_required_privileges() {
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
            self.advanced = (-1, self.evidence.observed_ns());
            let present = started(self.settings).iter().fold(0, |bits, p| bits | bit(*p));
            self.shared.presence.present.store(present, Ordering::Release);
            for slot in &mut self.slots {
                slot.restart.stage = hapfic_gate::restart_policy::RestartStage::Working;
            }
            self.inject()?;
            if self.clock == Clock::Realtime
                && SchedGrants(self.shared.heartbeats.read(recorder::GATE).realtime).has(SchedGrants::FIFO)
            {
                // Restarts must not wait for other processes of the machine; without the privilege they do.
                let _ = realtime::set_fifo(WATCH_PRIORITY);
            }
            self.shared.orders.start.store(true, Ordering::Release);
            completed = self.follow()?;
            if completed {
                let last = self.shared.gate.tick.load(Ordering::Relaxed);
                self.report(last, Process::Supervisor, EventKind::Ended, Severity::Nominal, Detector::None, "all ticks are done");
            }
        }
        Ok(RunTimes {
            launch_s,
            wall_s: begun.elapsed().as_secs_f64(),
            steal_ms: summary::steal_ms().saturating_sub(steal_before_ms),
            completed,
        })
    }

    /// Records a fault that the run does not survive.
    pub fn fault(&mut self, process: &str, what: String, detector: Detector) {
        let tick = self.shared.gate.tick.load(Ordering::Relaxed);
        let kind = match detector {
            Detector::Exit | Detector::Heartbeat | Detector::Tick | Detector::Check | Detector::Budget => EventKind::Lost,
            _ => EventKind::Ended,
        };
        let about = Process::from_name(process).unwrap_or(Process::Supervisor);
        self.report(tick, about, kind, Severity::Stopped, detector, &format!("{process} {what}"));
        self.faults.push(RunFault { process: process.to_owned(), what, detector, tick });
    }

    /// Sends an event to the log. Sending fails only with the recorder, whose failure `healthy` detects.
    fn report(&mut self, tick: i64, about: Process, kind: EventKind, severity: Severity, seen: Detector, text: &str) {
        let stamp_ns = if self.clock == Clock::Realtime { hapfic_ipc::clock::now_ns() } else { 0 };
        let _ = self.events.send(&Event { stamp_ns, ..Event::new(tick, about, kind, severity, seen, text) });
    }

    /// Sends an event of the current tick and severity.
    fn note(&mut self, about: Process, kind: EventKind, seen: Detector, text: &str) {
        let severity = Severity::from_code(self.shared.gate.severity.load(Ordering::Relaxed)).unwrap_or(Severity::Nominal);
        self.report(self.shared.gate.tick.load(Ordering::Relaxed), about, kind, severity, seen, text);
    }

    /// Waits until all processes report that they are ready; `false` if one does not.
    fn wait_until_ready(&mut self) -> Result<bool> {
        let deadline = Instant::now() + Duration::from_millis(self.settings.supervisor.ready_timeout_ms.into());
        loop {
            if !self.healthy()? {
                return Ok(false);
            }
            let missing: Vec<_> = started(self.settings)
                .iter()
                .chain([&recorder::GATE])
                .filter(|p| self.shared.heartbeats.read(**p).phase.is_none())
                .map(|p| p.name())
                .collect();
            if missing.is_empty() {
                return Ok(true);
            }
            if Instant::now() > deadline {
                for process in missing {
                    self.fault(process, "did not get ready in time".to_owned(), Detector::Start);
                }
                return Ok(false);
            }
            self.pause(FAST_POLL_INTERVAL);
        }
    }

    /// Watches the run; returns whether it completed.
    fn follow(&mut self) -> Result<bool> {
        let mut progress = Progress::new(self.settings.duration_ticks as f64 * PERIOD_S);
        loop {
            if self.shared.gate.tick.load(Ordering::Acquire) + 1 >= self.settings.duration_ticks as i64 {
                progress.clear();
                let stopped = self.shared.gate.severity.load(Ordering::Relaxed) == Severity::Stopped.code();
                if stopped && !self.stopped_by_budget {
                    self.fault("supervisor", "was in a latched stop when the run ended".to_owned(), Detector::Operator);
                }
                return Ok(true);
            }
            if !self.healthy()? {
                progress.clear();
                return Ok(false);
            }
            if let Ok(snapshot) = self.shared.recorder.snapshot.lock() {
                progress.show(&snapshot, self.shared.gate.counts().missed);
            }
            self.notify.watchdog();
            let joining = self.slots.iter().any(ProcessSlot::joining);
            if joining {
                self.cache.preloan();
                for doorbell in &self.doorbells {
                    doorbell.notify();
                }
            }
            let near = joining || self.injections.near(self.shared.gate.tick.load(Ordering::Relaxed), NEAR_TICKS);
            self.pause(if near { FAST_POLL_INTERVAL } else { POLL_INTERVAL });
        }
    }

    /// Waits until a process ends, or for `time`.
    fn pause(&self, time: Duration) {
        children::watch(self.slots.iter().filter_map(|s| s.child.as_ref()), time);
    }

    /// Injects the faults that are due.
    fn inject(&mut self) -> Result<()> {
        let gated = self.shared.gate.tick.load(Ordering::Acquire);
        for (fault, what) in self.injections.act(&mut self.slots, &self.shared, gated)? {
            let about = Process::from_name(fault.target.name()).unwrap_or(Process::Supervisor);
            self.note(about, EventKind::Injected, Detector::None, &format!("injected fault: {what}"));
        }
        Ok(())
    }

    /// With `--realtime require`: whether every thread has all privileges that it requested.
    fn has_required_privileges(&mut self) -> bool {
        if self.request.realtime != RealtimeMode::Require {
            return true;
        }
        let missing = privileges::missing(self.settings, self.cores, &self.shared);
        for (process, what) in &missing {
            self.fault(process, format!("did not get {what}, which --realtime require demands"), Detector::Start);
        }
        missing.is_empty()
    }

    /// Largest delay of the main thread so far.
    #[must_use]
    pub fn largest_delay(&self) -> Duration {
        self.evidence.largest_delay()
    }

    /// Losses and injected faults of the run.
    #[must_use]
    pub fn losses(&self) -> Losses {
        let present = self.shared.presence.present.load(Ordering::Acquire);
        let recovered = |process: Process| present & bit(process) != 0;
        let slots = self.slots.iter().map(|s| (s.process, s.losses, s.longest, recovered(s.process)));
        Losses::new(slots, self.injections.done)
    }

    /// Ends gate and processes, then lets the recorder drain the remaining messages.
    ///
    /// # Errors
    /// If the system does not report how a process ended.
    pub fn end(&mut self, completed: bool) -> Result<()> {
        self.notify.stopping();
        if completed {
            // A controller whose request the last tick did not need still sends it.
            let begun = Instant::now();
            let done =
                |s: &ProcessSlot| s.child.is_none() || self.shared.heartbeats.read(s.process).phase == Some(Phase::Finished);
            while !self.slots.iter().all(done) && begun.elapsed() < LAST_TICK_TIMEOUT {
                self.pause(FAST_POLL_INTERVAL);
            }
        }
        self.shared.orders.stop.store(true, Ordering::Release);
        if let Some(gate) = self.gate.take() {
            match gate.join() {
                Ok(Ok(())) => {}
                Ok(Err(e)) => self.fault("gate", e.to_string(), Detector::Exit),
                Err(_) => self.fault("gate", "panicked".to_owned(), Detector::Exit),
            }
        }
        if completed {
            // Their last messages lie in their own memory: the recorder drains them before the processes end.
            let begun = Instant::now();
            let seen = self.shared.recorder.rounds.load(Ordering::Acquire);
            while self.shared.recorder.rounds.load(Ordering::Acquire) < seen + 2 && begun.elapsed() < LAST_TICK_TIMEOUT {
                self.pause(FAST_POLL_INTERVAL);
            }
        }
        let children: Vec<Child> = self.slots.iter_mut().filter_map(|s| s.child.take()).collect();
        let killed = children::end(children)?;
        for process in killed.processes {
            self.fault(process.name(), "did not end on request, and was killed".to_owned(), Detector::Exit);
        }
        self.abandoned.extend(killed.abandoned);
        for child in std::mem::take(&mut self.abandoned).iter_mut() {
            if child.ended()?.is_none() {
                self.fault(
                    child.process.name(),
                    format!("is left behind: it does not end after SIGKILL ({})", child.remains()),
                    Detector::Exit,
                );
            }
        }
        self.shared.orders.drain.store(true, Ordering::Release);
        Ok(())
    }
}

impl Drop for Watch<'_> {
    fn drop(&mut self) {
        // Errors have no receiver here: `end` reports them.
        let _ = children::end(self.slots.iter_mut().filter_map(|s| s.child.take()).collect());
    }
}

/// Bit of a process in a set of processes.
fn bit(process: Process) -> u32 {
    1 << process.code()
}
