//! One run from start to end: everything checked first, then started, watched, ended, and removed.

use crate::children;
use crate::notify::Notify;
use crate::operator::{self, Served};
use crate::privileges::{self, Cores};
use crate::recorder::{self, Recorder};
use crate::registry::Place;
use crate::request::Request;
use crate::summary::{Fault, Losses, Recorder as RecorderSummary, Run, Summary};
use crate::watch::{self, Begin, Timed, Watch};
use anyhow::{Context, Result};
use hapfic_gate::Limits;
use hapfic_gate::parameter_schedule::Timeline;
use hapfic_gate::torque_check::TorqueCheck;
use hapfic_gate_process::shared_status::Live;
use hapfic_gate_process::{Gateway, Start as GateStart};
use hapfic_ipc::realtime::{BringIn, IdleHold, Wish};
use hapfic_ipc::{Bus, Domain, IpcError, RunFile, topic};
use hapfic_log::{RunLog, Viewer, Writer, scene};
use hapfic_messages::{Clock, RealtimeMode};
use hapfic_plant::Plant;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::thread::JoinHandle;
use std::time::Duration;

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
        for process in children::started(settings) {
            children::find_program(&settings.processes, *process)?;
        }
        watch::check_faults(&settings.faults, &request.log, settings.supervisor.standby)?;
        let place = Place::take(&request.scenario, &request.log)?;
        // Before this run's log is made: it may be the same file.
        place.orphaned_logs().iter().for_each(|log| recover_orphan(log));
        let start_unix_ns = if request.clock == Clock::Realtime { hapfic_ipc::clock::unix_ns() } else { 0 };
        let writer = hapfic_log::create_run_log(&run_log(request, &plant, start_unix_ns))?;
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
        hapfic_ipc::service::quiet();
        let domain = Domain::new(&place.prefix(), &place.root())?.hasty(request.clock);
        let realtime = request.clock == Clock::Realtime && request.realtime != RealtimeMode::Off;
        let fifo = realtime && hapfic_ipc::realtime::may_fifo(settings.realtime.priority_plant as i32);
        let cores = Cores::new(&settings.realtime, place.others(), fifo);
        let run_file = Path::new(&place.root()).join("run.json");
        RunFile {
            prefix: place.prefix(),
            root: place.root(),
            supervisor_pid: std::process::id() as i32,
            clock: request.clock,
            realtime: request.realtime,
            core: cores.shared,
            reserve_core: cores.reserve,
            gate_core: cores.gate,
            settings: settings.effective_toml(),
            urdf_name: settings.robot.urdf.name.clone(),
            urdf: settings.robot.urdf.text.clone(),
        }
        .write(&run_file)?;
        if realtime {
            hapfic_ipc::realtime::lock_memory(BringIn::All);
        }
        // Without it a tick is held up some time.
        let _ = hapfic_ipc::realtime::make_room_for_files(FILES);
        // First of all, and until the end: a service whose maker dies while making it can be lost for good.
        let bus = Bus::open(&domain, "supervisor")?;
        place.close_to_others()?;
        let _services = hold_all(&bus)?;
        let _idle = if realtime { IdleHold::take() } else { None };

        let live = Arc::new(Live::new());
        let recorder = Recorder::start(recorder::Start {
            domain: domain.clone(),
            clock: request.clock,
            credit_ticks: settings.supervisor.credit_ticks,
            writer,
            viewer,
            chain: plant.chain().clone(),
            flush_every: Duration::from_millis(settings.recorder.flush_ms.into()),
            log: request.log.clone(),
            live: Arc::clone(&live),
        })?;
        let here = plant.sample().foot_position;
        let (desk, hatch) = hapfic_gate_process::change_exchange::exchange();
        let (inject, asked) = std::sync::mpsc::channel();
        let notify = Notify::from_env();
        // Before the gate, so that its failure leaves nobody behind.
        let _served = Served::start(operator::Start {
            domain: domain.clone(),
            run: place.prefix().trim_end_matches('_').to_owned(),
            scenario: request.scenario.clone(),
            clock: request.clock,
            log: request.log.clone(),
            ticks: settings.duration_ticks as i64,
            initial: hapfic_config::Parameters {
                target_position: settings.initial.target_position.or(Some(here)),
                ..settings.initial
            },
            desk,
            inject,
            standby: settings.supervisor.standby,
            live: Arc::clone(&live),
        })?;
        let gate = start_gate(GateStart {
            domain,
            clock: request.clock,
            limits: Limits::new(settings, plant.chain()),
            torque: TorqueCheck::new(plant.chain().clone(), settings.world.gravity_m_per_s2),
            timeline: Timeline::new(settings, here),
            ticks: settings.duration_ticks as i64,
            deadline: Duration::from_micros(settings.supervisor.deadline_us.into()),
            wish: realtime.then(|| Wish::new(settings.realtime.priority_gate, cores.gate)),
            alarm: realtime.then(|| Wish::new(settings.realtime.priority_gate, cores.reserve)),
            look_out_us: if cores.gate_looks_out { settings.realtime.look_out_us } else { 0 },
            understudy: cores.understudy.map(|core| Wish::new(settings.realtime.priority_gate, Some(core))),
            hatch,
            live: Arc::clone(&live),
        })?;

        let mut watch = Watch::open(
            &bus,
            Begin {
                request,
                live: Arc::clone(&live),
                gate,
                recorder: &recorder,
                stop,
                run_file: &run_file,
                cores,
                asked,
                notify: &notify,
            },
        )?;
        let timed = match watch.start_and_follow() {
            Ok(timed) => timed,
            // From here on nothing may end without ending everyone.
            Err(e) => {
                watch.fault("supervisor", format!("{e:#}"), "start");
                Timed::default()
            }
        };
        watch.end(timed.completed)?;
        let faults = std::mem::take(&mut watch.faults);
        let losses = watch.losses();
        drop(watch);
        Ok(summarise(request, timed, faults, losses, recorder))
    }
}

/// Files that a supervisor may have open: some 250 when all have joined, and more with each that dies and is started again.
const FILES: u64 = 1024;
/// Largest log of a killed run that a start recovers by itself, bytes: about a second's work.
const QUICKLY_RECOVERED: u64 = 64 << 20;

/// Makes the log of a run whose supervisor was killed readable, and says so. What cannot be done is no reason not to start.
fn recover_orphan(log: &Path) {
    // A pipe would wait for somebody to write.
    let Some(found) = std::fs::metadata(log).ok().filter(std::fs::Metadata::is_file) else { return };
    if found.len() > QUICKLY_RECOVERED {
        crate::say(&format!("hapfic: a run was killed; `hapfic recover {}` makes its log readable", log.display()));
        return;
    }
    match hapfic_log::recover(log, None) {
        Ok(recovery) => {
            if let Some(output) = &recovery.output {
                crate::say(&format!("hapfic: a run was killed; its log is recovered to {}", output.display()));
            }
        }
        Err(e) => crate::say(&format!("hapfic: a run was killed, and its log cannot be recovered: {e}")),
    }
}

fn start_gate(start: GateStart) -> Result<JoinHandle<Result<(), IpcError>>> {
    std::thread::Builder::new().name("hapfic-gate".to_owned()).spawn(move || Gateway::run(start)).context("cannot start the gate")
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
        bus.hold(&topic::INJECTION)?,
        hapfic_ipc::service::hold(bus)?,
    ])
}

fn run_log<'a>(request: &'a Request, plant: &'a Plant, start_unix_ns: u64) -> RunLog<'a> {
    RunLog {
        path: &request.log,
        scenario: &request.scenario,
        settings: &request.settings,
        clock: request.clock,
        chain: plant.chain(),
        body_names: plant.body_names(),
        start_unix_ns,
    }
}

fn summarise(request: &Request, timed: Timed, mut faults: Vec<Fault>, losses: Losses, recorder: Recorder) -> Summary {
    let (recorded, incidents, error) = recorder.finish();
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
        stood_in: timed.stood_in,
        losses,
        incidents,
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
