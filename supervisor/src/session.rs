//! One run from start to end: everything checked first, then started, watched, ended, and removed.

use crate::children::{self, Child, Children, describe};
use crate::gate::core::Limits;
use crate::gate::timeline::Timeline;
use crate::gate::{Gateway, Start as GateStart};
use crate::live::Live;
use crate::privileges;
use crate::progress::Progress;
use crate::recorder::{self, Recorder};
use crate::registry::Place;
use crate::scene;
use crate::summary::{self, Fault, Recorder as RecorderSummary, Run, Summary};
use anyhow::{Context, Result};
use hapfic_config::{PERIOD_S, Placement, Settings};
use hapfic_ipc::message::{Detector, Event, EventKind, MAX_JOINTS, Phase, Process, Severity};
use hapfic_ipc::realtime::IdleHold;
use hapfic_ipc::{Bus, Clock, Domain, IpcError, Output, RealtimeMode, RunFile, topic};
use hapfic_log::{Attachment, Names, Viewer, Writer, WriterOptions};
use hapfic_plant::Plant;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How often the supervisor looks at its processes when nothing calls.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// Processes started, in this order. The controller of the standby comes with fault tolerance.
const STARTED: [Process; 3] = [Process::Plant, Process::Planner, Process::Controller];

/// What to run.
#[derive(Clone, Debug)]
pub struct Request {
    /// Name for messages and the log.
    pub scenario: String,
    /// The checked scenario.
    pub settings: Settings,
    /// How time passes.
    pub clock: Clock,
    /// How hard to try for real time.
    pub realtime: RealtimeMode,
    /// Where to log.
    pub log: PathBuf,
    /// When the program started.
    pub since: Instant,
}

/// An error of what was asked for, before anything was started.
#[derive(Debug)]
pub struct Refused(pub anyhow::Error);

/// Runs a scenario.
///
/// # Errors
/// `Ok(Err(Refused))` if it cannot be started as asked; `Err` if the machinery fails.
pub fn run(request: &Request) -> Result<Result<Summary, Refused>> {
    let prepared = match Prepared::new(request) {
        Ok(prepared) => prepared,
        Err(e) => return Ok(Err(Refused(e))),
    };
    prepared.run(request).map(Ok)
}

/// Everything that can fail because of what was asked for, done.
struct Prepared {
    place: Place,
    plant: Plant,
    writer: Writer,
    viewer: Viewer,
    stop: Arc<AtomicBool>,
}

impl Prepared {
    fn new(request: &Request) -> Result<Self> {
        let settings = &request.settings;
        let plant = Plant::new(settings)?;
        privileges::require(settings, request.clock, request.realtime)?;
        for process in STARTED {
            children::find_program(&settings.processes, process)?;
        }
        let place = Place::take(&request.scenario, &request.log)?;
        let start_unix_ns = if request.clock == Clock::Realtime { hapfic_ipc::clock::unix_ns() } else { 0 };
        let writer = open_log(request, &plant, start_unix_ns)?;
        let viewer =
            Viewer::new(scene::scene(settings, plant.chain()), settings.recorder.viewer_rate_hz.round() as u32, start_unix_ns);
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP] {
            // The second one ends at once, whatever is still being waited for; the next start then cleans up.
            signal_hook::flag::register_conditional_shutdown(signal, 3, Arc::clone(&stop)).context("cannot handle signals")?;
            signal_hook::flag::register(signal, Arc::clone(&stop)).context("cannot handle signals")?;
        }
        Ok(Self { place, plant, writer, viewer, stop })
    }

    fn run(self, request: &Request) -> Result<Summary> {
        let Self { place, plant, writer, viewer, stop } = self;
        let settings = &request.settings;
        let domain = Domain::new(&place.prefix(), &place.root())?;
        let core = match settings.realtime.placement {
            Placement::OneCore => hapfic_ipc::realtime::shared_core(place.others()),
            Placement::Free => None,
        };
        let run_file = Path::new(&place.root()).join("run.json");
        RunFile {
            prefix: place.prefix(),
            root: place.root(),
            supervisor_pid: std::process::id() as i32,
            clock: request.clock,
            realtime: request.realtime,
            core,
            settings: settings.effective_toml(),
            urdf_name: settings.robot.urdf.name.clone(),
            urdf: settings.robot.urdf.text.clone(),
        }
        .write(&run_file)?;
        // First of all, and until the end: a service whose maker dies while making it can be lost for good.
        let bus = Bus::open(&domain, "supervisor")?;
        let _services = hold_all(&bus)?;
        let realtime = request.clock == Clock::Realtime && request.realtime != RealtimeMode::Off;
        let _idle = if realtime { IdleHold::take() } else { None };

        let live = Arc::new(Live::new());
        live.gated.store(-1, Ordering::Relaxed);
        let recorder = Recorder::start(recorder::Start {
            domain: domain.clone(),
            clock: request.clock,
            credit_ticks: settings.supervisor.credit_ticks,
            writer,
            viewer,
            chain: plant.chain().clone(),
            flush_every: Duration::from_millis(settings.recorder.flush_ms.into()),
            live: Arc::clone(&live),
        })?;
        let gate = start_gate(GateStart {
            domain,
            clock: request.clock,
            limits: limits(settings, &plant),
            timeline: Timeline::new(settings, plant.sample().foot_position),
            ticks: settings.duration_ticks as i64,
            deadline: Duration::from_micros(settings.supervisor.deadline_us.into()),
            wish: realtime.then(|| GateStart::wish(settings, core)),
            live: Arc::clone(&live),
        })?;

        let mut watch = Watch {
            settings,
            live: Arc::clone(&live),
            children: Children::default(),
            gate: Some(gate),
            recorder: &recorder,
            stop,
            faults: Vec::new(),
            events: bus.output(&topic::EVENT)?,
            advanced: (-1, Instant::now()),
        };
        let timed = match watch.start_and_follow(request, &run_file, core) {
            Ok(timed) => timed,
            // From here on nothing may end without ending everyone.
            Err(e) => {
                watch.fault("supervisor", format!("{e:#}"), "start");
                Timed::default()
            }
        };
        watch.end(timed.completed)?;
        let faults = std::mem::take(&mut watch.faults);
        drop(watch);
        Ok(summarise(request, timed, faults, recorder))
    }
}

/// When a run started and ended.
#[derive(Default)]
struct Timed {
    launch_s: f64,
    wall_s: f64,
    steal_ms: u64,
    completed: bool,
}

/// The main thread's view of a run.
struct Watch<'a> {
    settings: &'a Settings,
    live: Arc<Live>,
    children: Children,
    gate: Option<JoinHandle<Result<(), IpcError>>>,
    recorder: &'a Recorder,
    stop: Arc<AtomicBool>,
    faults: Vec<Fault>,
    events: Output<Event>,
    /// Last tick that had been gated, and when that was first seen.
    advanced: (i64, Instant),
}

impl Watch<'_> {
    fn start_and_follow(&mut self, request: &Request, run_file: &Path, core: Option<u32>) -> Result<Timed> {
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

    fn fault(&mut self, process: &str, what: String, detector: &'static str) {
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
        let limit = u64::from(self.settings.supervisor.heartbeat_timeout_ms) * 1_000_000;
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
    fn end(&mut self, completed: bool) -> Result<()> {
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
            std::thread::sleep(Duration::from_millis(10));
        }
        for process in self.children.end()? {
            self.fault(process.name(), "did not end when asked to, and was killed".to_owned(), "exit");
        }
        self.live.drain.store(true, Ordering::Release);
        Ok(())
    }
}

fn start_gate(start: GateStart) -> Result<JoinHandle<Result<(), IpcError>>> {
    std::thread::Builder::new()
        .name("hapfic-gate".to_owned())
        .spawn(move || Gateway::open(start)?.run())
        .context("cannot start the gate")
}

fn hold_all(bus: &Bus) -> Result<Vec<Box<dyn std::any::Any>>> {
    Ok(vec![
        bus.hold(&topic::STATE)?,
        bus.hold(&topic::REFERENCE)?,
        bus.hold(&topic::REQUEST)?,
        bus.hold(&topic::COMMAND)?,
        bus.hold(&topic::OPERATOR)?,
        bus.hold(&topic::EVENT)?,
        bus.hold(&topic::TIMING)?,
        bus.hold(&topic::CREDIT)?,
    ])
}

fn limits(settings: &Settings, plant: &Plant) -> Limits {
    let joints = plant.chain().joints();
    let mut peak = [0.0; MAX_JOINTS];
    for (i, joint) in joints.iter().enumerate() {
        peak[i] = settings.supervisor.torque_peak.as_ref().map_or(joint.effort, |list| list[i]);
    }
    Limits { joints: joints.len(), bandwidth_hz: settings.supervisor.torque_bandwidth_hz, peak, period_s: PERIOD_S }
}

fn open_log(request: &Request, plant: &Plant, start_unix_ns: u64) -> Result<Writer> {
    if let Some(folder) = request.log.parent()
        && !folder.as_os_str().is_empty()
    {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}, the log's folder", folder.display()))?;
    }
    let settings = &request.settings;
    let names = Names {
        joints: plant.chain().joints().iter().map(|j| j.name.clone()).collect(),
        bodies: plant.body_names().to_vec(),
        objects: Vec::new(),
    };
    let pairs = [
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ("scenario", request.scenario.clone()),
        ("title", settings.title.clone()),
        ("clock", request.clock.name().to_owned()),
        ("seed", settings.seed.to_string()),
        ("period_s", PERIOD_S.to_string()),
        ("duration_ticks", settings.duration_ticks.to_string()),
        ("start_unix_ns", start_unix_ns.to_string()),
    ];
    let header: BTreeMap<_, _> = pairs.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
    let attachments = [
        Attachment {
            name: "scenario.toml".to_owned(),
            media_type: "application/toml".to_owned(),
            bytes: settings.effective_toml().into_bytes(),
        },
        Attachment {
            name: "robot.urdf".to_owned(),
            media_type: "application/xml".to_owned(),
            bytes: settings.robot.urdf.text.clone().into_bytes(),
        },
    ];
    let options = WriterOptions { start_unix_ns, chunk_bytes: u64::from(settings.recorder.chunk_kib) * 1024 };
    Ok(Writer::create(&request.log, &names, &[("hapfic".to_owned(), header)], &attachments, &options)?)
}

fn summarise(request: &Request, timed: Timed, mut faults: Vec<Fault>, recorder: Recorder) -> Summary {
    let (recorded, error) = recorder.finish();
    let mut completed = timed.completed && faults.is_empty();
    if let Some(error) = error {
        completed = false;
        faults.push(Fault {
            process: "recorder".to_owned(),
            what: error,
            detector: "recorder",
            tick: recorded.and_then(|r| r.metrics.ticks.last).unwrap_or(-1),
        });
    }
    if completed && recorded.is_some_and(|r| !r.active) {
        completed = false;
        let what = "made no request that could be used, in the whole run".to_owned();
        faults.push(Fault { process: "controller".to_owned(), what, detector: "tick", tick: -1 });
    }
    let metrics = recorded.map(|r| r.metrics).unwrap_or_default();
    let run = Run {
        scenario: request.scenario.clone(),
        clock: request.clock.name(),
        wall_s: timed.wall_s,
        launch_s: timed.launch_s,
        completed,
        steal_ms: timed.steal_ms,
        faults,
        log: request.log.clone(),
    };
    let mut lost = metrics.ticks.lost;
    if timed.completed && metrics.ticks.last.is_some() {
        // The gaps, and what is missing at the start and at the end.
        let written: u64 = recorded.map_or(0, |r| r.ticks.iter().sum());
        lost = (2 * request.settings.duration_ticks).saturating_sub(written);
    }
    let log =
        RecorderSummary { messages: recorded.map_or(0, |r| r.messages), lost, file_bytes: recorded.map_or(0, |r| r.file_bytes) };
    Summary::new(run, &metrics, log)
}
