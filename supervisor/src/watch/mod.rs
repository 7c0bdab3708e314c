//! The main thread during a run: starts, watches, restarts and ends the processes.
//!
//! Read [`Watch`] first, then `follow.rs` (the course of a run) and `take_over.rs` (that of a successor), `detect.rs` with
//! `evidence.rs` and `slot.rs` (when a process is lost), and `restart.rs` with `recorder.rs`, `latest_inputs.rs`,
//! `dead_nodes.rs` and `clean_up.rs` (what happens then).

mod clean_up;
mod dead_nodes;
mod detect;
mod evidence;
mod follow;
mod inject;
mod latest_inputs;
mod recorder;
mod restart;
mod slot;
mod take_over;

use crate::children::{self, Child};
use crate::latest::LatestMessages;
use crate::notify::Notify;
use crate::privileges::Cores;
use crate::recorder::Recorder;
use crate::request::RunRequest;
use crate::summary::{Losses, RunFault};
use anyhow::Result;
use evidence::{Evidence, Suspicion};
use hapfic_config::Settings;
use hapfic_ipc::SharedStatus;
use hapfic_ipc::{Bus, Doorbell, GatePage, Output, SupervisorPage, topic};
use hapfic_messages::{Clock, Credit, Detector, Event, EventKind, Process, Severity};
use inject::Injections;
use latest_inputs::LatestInputs;
use slot::ProcessSlot;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

pub use dead_nodes::DeadNodes;
pub use inject::{check as check_faults, describe as describe_fault, possible as fault_possible};
pub use recorder::RecorderEnd;

/// Faults of a run, in its folder.
const FAULTS_FILE: &str = "faults.json";
/// Priority of the main thread in realtime: below all ticking and all starting processes.
pub(crate) const WATCH_PRIORITY: u32 = 5;
/// Interval at which the supervisor polls its processes.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// The same while a process starts, or an injected fault is near.
const FAST_POLL_INTERVAL: Duration = Duration::from_millis(1);

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
    /// Recorder of the run, and its process in its first start.
    pub recorder: (&'a Recorder<'a>, Option<Child>),
    /// Page of the supervisor.
    pub record: &'a SupervisorPage,
    /// Dead processes of a supervisor that is lost.
    pub dead_nodes: DeadNodes,
    /// Process that starts supervisors.
    pub launcher_pid: i32,
    /// Page of the two gates.
    pub gates: &'a GatePage,
    /// Latest messages of the run.
    pub latest: Arc<LatestMessages>,
    /// Flag that signals set to end the run.
    pub stop: Arc<AtomicBool>,
    /// Prefix of the run's segments in shared memory.
    pub prefix: String,
    /// The run's folder.
    pub root: PathBuf,
    /// Path of the run file, which the processes read.
    pub run_file: &'a Path,
    /// Cores of the real-time threads.
    pub cores: Cores,
    /// Faults that operators request.
    pub fault_requests: std::sync::mpsc::Receiver<hapfic_config::Fault>,
    /// Connection to the service manager.
    pub notify: &'a Notify,
}

/// Data and connections that are fixed during a run.
struct RunContext<'a> {
    request: &'a RunRequest,
    settings: &'a Settings,
    clock: Clock,
    shared: Arc<SharedStatus>,
    recorder: &'a Recorder<'a>,
    record: &'a SupervisorPage,
    launcher_pid: i32,
    gates: &'a GatePage,
    latest: Arc<LatestMessages>,
    stop: Arc<AtomicBool>,
    /// Prefix of the run's segments in shared memory.
    prefix: String,
    root: PathBuf,
    run_file: &'a Path,
    cores: Cores,
    notify: &'a Notify,
    bus: &'a Bus,
}

/// State of the detector for a run that does no ticks.
#[derive(Default)]
struct StallDetector {
    /// Last gated tick, and the observed time at which it was new [ns].
    advanced: (i64, u64),
    /// Suspicions of all processes, if no tick was done for half of the time-out.
    suspicions: Vec<Suspicion>,
    /// Whether the plant may still be restarted since the last tick.
    plant_restart_left: bool,
    /// Whether all others have been restarted since the last tick.
    all_restarted: bool,
}

/// The main thread's view of a run.
pub struct Watch<'a> {
    run: RunContext<'a>,
    slots: Vec<ProcessSlot>,
    /// Killed processes that have not ended: frozen, or inside an uninterruptible system call.
    abandoned: Vec<Child>,
    /// Code of the primary controller that got its priority and core last.
    primary: u32,
    inputs: LatestInputs,
    /// Grants the plant all ticks, once a run in lockstep goes on without its recorder.
    credit: Output<Credit>,
    injections: Injections<'a>,
    doorbells: Vec<Doorbell>,
    events: Output<Event>,
    begun: Instant,
    /// Re-armings handled so far.
    rearms: u64,
    evidence: Evidence,
    stall: StallDetector,
    dead_nodes: DeadNodes,
    /// Whether a spent budget requested a latched stop, and no re-arming followed.
    stopped_by_budget: bool,
    /// Faults so far that the run does not survive.
    pub faults: Vec<RunFault>,
}

impl<'a> Watch<'a> {
    /// Opens the main thread's ports, before any process starts.
    ///
    /// # Errors
    /// If the ports cannot be opened, or a thread cannot be started.
    pub fn open(bus: &'a Bus, start: WatchStart<'a>) -> Result<Self> {
        let WatchStart {
            request,
            shared,
            recorder: (recorder, recorder_process),
            record,
            dead_nodes,
            launcher_pid,
            gates,
            latest,
            stop,
            prefix,
            root,
            run_file,
            cores,
            fault_requests,
            notify,
        } = start;
        let doorbells = [&topic::STATE.doorbell, &topic::REFERENCE.doorbell, &topic::REQUEST.doorbell]
            .into_iter()
            .chain([&topic::COMMAND.doorbell, &topic::CREDIT.doorbell])
            .flatten()
            .chain([&topic::SPARE_GATE])
            .map(|index| bus.doorbell(*index))
            .collect();
        let settings = &request.settings;
        let gated = shared.gate.tick.load(Ordering::Acquire);
        Ok(Self {
            slots: recorder_process.into_iter().map(|child| ProcessSlot::new(Process::Recorder, child)).collect(),
            abandoned: Vec::new(),
            primary: shared.gate.primary.load(Ordering::Relaxed),
            inputs: LatestInputs::open(bus, settings, request.clock)?,
            credit: bus.output(&topic::CREDIT)?,
            injections: Injections::new(
                &settings.faults,
                fault_requests,
                bus.output(&topic::INJECTION)?,
                &request.log,
                record,
                gated,
            ),
            doorbells,
            events: bus.kept_output(&topic::EVENT, Process::Supervisor, request.clock)?,
            begun: Instant::now(),
            rearms: shared.orders.rearms.load(Ordering::Acquire),
            evidence: Evidence::default(),
            stall: StallDetector { advanced: (-1, 0), plant_restart_left: true, ..StallDetector::default() },
            dead_nodes,
            stopped_by_budget: false,
            faults: Vec::new(),
            run: RunContext {
                settings,
                clock: request.clock,
                request,
                shared,
                recorder,
                record,
                launcher_pid,
                gates,
                latest,
                stop,
                prefix,
                root,
                run_file,
                cores,
                notify,
                bus,
            },
        })
    }

    /// Records a fault that the run does not survive.
    pub fn fault(&mut self, process: &str, what: String, detector: Detector) {
        let tick = self.run.shared.gate.tick.load(Ordering::Relaxed);
        let kind = match detector {
            Detector::Exit | Detector::Heartbeat | Detector::Tick | Detector::Check | Detector::Budget => EventKind::Lost,
            _ => EventKind::Ended,
        };
        let about = Process::from_name(process).unwrap_or(Process::Supervisor);
        self.report(tick, about, kind, Severity::Stopped, detector, &format!("{process} {what}"));
        self.faults.push(RunFault { process: process.to_owned(), what, detector, tick });
        self.keep_faults();
    }

    /// Leaves the faults so far in the run's folder, for a successor.
    fn keep_faults(&self) {
        let faults = RunFault::to_text(&self.faults);
        // Without memory the run ends anyway, and what a successor does not know is not in its summary.
        let _ = crate::recorder::replace(&self.run.root.join(FAULTS_FILE), faults.as_bytes());
    }

    /// Sends an event to the log. Sending fails only with the recorder, whose failure `healthy` detects.
    fn report(&mut self, tick: i64, about: Process, kind: EventKind, severity: Severity, seen: Detector, text: &str) {
        let stamp_ns = if self.run.clock == Clock::Realtime { hapfic_ipc::clock::now_ns() } else { 0 };
        let _ = self.events.send(&Event { stamp_ns, ..Event::new(tick, about, kind, severity, seen, text) });
    }

    /// Sends an event of the current tick and severity.
    fn note(&mut self, about: Process, kind: EventKind, seen: Detector, text: &str) {
        let severity = Severity::from_code(self.run.shared.gate.severity.load(Ordering::Relaxed)).unwrap_or(Severity::Nominal);
        self.report(self.run.shared.gate.tick.load(Ordering::Relaxed), about, kind, severity, seen, text);
    }

    /// Largest delay of the main thread so far.
    #[must_use]
    pub fn largest_delay(&self) -> Duration {
        Duration::from_nanos(self.run.record.largest_delay_ns.load(Ordering::Relaxed))
    }

    /// Losses and injected faults of the run.
    #[must_use]
    pub fn losses(&self) -> Losses {
        let present = self.run.shared.presence.present.load(Ordering::Acquire);
        let recovered = |process: Process| present & bit(process) != 0;
        let slots = self.slots.iter().map(|s| (s.process, s.losses, s.longest, recovered(s.process)));
        let record = self.run.record;
        let longest = Duration::from_nanos(record.longest_ns.load(Ordering::Relaxed));
        let own = (Process::Supervisor, record.losses.load(Ordering::Relaxed), longest, true);
        Losses::new(slots.chain([own]), record.injected.load(Ordering::Relaxed))
    }
}

impl Drop for Watch<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            // A successor takes the processes over.
            return;
        }
        // Errors have no receiver here: `end` reports them.
        let _ = children::end(self.slots.iter_mut().filter_map(|s| s.child.take()).collect());
    }
}

/// Bit of a process in a set of processes.
fn bit(process: Process) -> u32 {
    1 << process.code()
}
