//! A run from start to end: checks, start, watch, end, and removal of its namespace.

use crate::children;
use crate::latest::LatestMessages;
use crate::notify::Notify;
use crate::operator::{self, OperatorServer};
use crate::preflight;
use crate::privileges::{self, Cores};
use crate::recorder::{self, Recorder, RecorderStart, RecordingOutcome};
use crate::registry::RunDirectory;
use crate::request::RunRequest;
use crate::summary::{Losses, RecorderSummary, RunFault, RunSummary, Summary};
use crate::watch::{self, RunTimes, Watch, WatchStart};
use anyhow::{Context, Result};
use hapfic_config::{OnFailure, Settings};
use hapfic_controller::parameters::TipPose;
use hapfic_gate_process::change_exchange::ChangeClient;
use hapfic_ipc::realtime::{CpuLatencyGuard, Prefault};
use hapfic_ipc::run_status::{GateCounts, SharedStatus};
use hapfic_ipc::{Bus, ChangePage, Domain, GatePage, ProcessStart, RunFile, topic};
use hapfic_log::{LogFile, RunLog};
use hapfic_messages::{Clock, Detector, RealtimeMode};
use hapfic_plant::{Plant, PlantError};
use hapfic_simulation::findings::{Advisor, degrees_hint};
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// An invalid run request; no process was started.
#[derive(Debug)]
pub struct InvalidRequest(pub anyhow::Error);

/// Runs a scenario.
///
/// # Errors
/// `Ok(Err(InvalidRequest))` if the request is invalid; `Err` if the supervisor itself fails.
pub fn run(request: &RunRequest) -> Result<Result<Summary, InvalidRequest>> {
    let prepared = match PreparedRun::new(request) {
        Ok(prepared) => prepared,
        Err(e) => return Ok(Err(InvalidRequest(e))),
    };
    prepared.run(request).map(Ok)
}

/// A checked request, with every resource that an invalid request can make fail.
struct PreparedRun {
    directory: RunDirectory,
    plant: Plant,
    advisor: Advisor,
    /// The created log.
    log: LogFile,
    log_id: Option<FileId>,
    start_unix_ns: u64,
    stop: Arc<AtomicBool>,
}

impl PreparedRun {
    fn new(request: &RunRequest) -> Result<Self> {
        let settings = &request.settings;
        let plant = Plant::new(settings).map_err(|error| with_degrees(error, settings))?;
        let advisor = Advisor::new(settings)?;
        privileges::require(settings, request.clock, request.realtime)?;
        preflight::check(settings, &request.log)?;
        for process in children::started(settings) {
            children::find_program(&settings.processes, *process)?;
        }
        watch::check_faults(&settings.faults, &request.log, settings.supervisor.standby)?;
        let directory = RunDirectory::take(&request.scenario, &request.log)?;
        // Recovery comes before this run creates its log, which may be the same file.
        directory.orphaned_logs().iter().for_each(|log| recover_orphan(log));
        let start_unix_ns = if request.clock == Clock::Realtime { hapfic_ipc::clock::unix_ns() } else { 0 };
        let log = hapfic_log::reserve_run_log(&run_log(request, &plant, start_unix_ns))?;
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP] {
            // The second signal ends the program immediately; the next start then cleans up.
            signal_hook::flag::register_conditional_shutdown(signal, 3, Arc::clone(&stop)).context("cannot handle signals")?;
            signal_hook::flag::register(signal, Arc::clone(&stop)).context("cannot handle signals")?;
        }
        // A scenario may intend what they describe.
        advisor.scenario().iter().for_each(|finding| crate::log_line(&finding.to_string()));
        Ok(Self { directory, plant, advisor, log, log_id: file_id(&request.log), start_unix_ns, stop })
    }

    fn run(self, request: &RunRequest) -> Result<Summary> {
        let Self { directory, plant, advisor, log, log_id, start_unix_ns, stop } = self;
        let settings = &request.settings;
        hapfic_ipc::service::silence_transport_log();
        let domain = Domain::new(&directory.prefix(), &directory.root())?.with_short_timeouts(request.clock);
        let realtime = request.clock == Clock::Realtime && request.realtime != RealtimeMode::Off;
        let fifo = realtime && hapfic_ipc::realtime::may_fifo(settings.realtime.priority_plant as i32);
        let cores = Cores::new(&settings.realtime, directory.others(), fifo);
        let run_file = Path::new(&directory.root()).join("run.json");
        let start = TipPose::of(&plant.chain().kinematics(&plant.sample().joint_position));
        RunFile {
            prefix: directory.prefix(),
            root: directory.root(),
            scenario: request.scenario.clone(),
            log: std::path::absolute(&request.log).unwrap_or_else(|_| request.log.clone()),
            start_unix_ns,
            supervisor_pid: std::process::id() as i32,
            clock: request.clock,
            realtime: request.realtime,
            core: cores.shared,
            standby_core: cores.reserve,
            gate_core: cores.gate,
            gate_busy_polls: cores.gate_busy_polls,
            spare_core: cores.spare,
            start_pose: [start.position, start.rpy],
            settings: settings.effective_toml(),
            urdf_name: settings.robot.urdf.name.clone(),
            urdf: settings.robot.urdf.text.clone(),
        }
        .write(&run_file)?;
        if realtime {
            hapfic_ipc::realtime::lock_memory(Prefault::All);
        }
        // A table that grows during the run delays a tick.
        let _ = hapfic_ipc::realtime::reserve_fd_table(FD_TABLE_SIZE);
        // The supervisor creates all services and keeps them: a creator that dies midway can make a service unusable.
        let bus = Bus::open(&domain, "supervisor")?;
        directory.close_to_others()?;
        let _services = keep_all_alive(&bus)?;
        let _idle = if realtime { CpuLatencyGuard::take() } else { None };

        let shared = Arc::new(SharedStatus::create(&directory.root())?);
        let latest = Arc::new(LatestMessages::default());
        let root = Path::new(&directory.root()).to_owned();
        let gates = GatePage::create(&directory.root())?;
        let recorder = Recorder::new(RecorderStart {
            root: root.clone(),
            clock: request.clock,
            settings,
            run_file: &run_file,
            log: &request.log,
            file: log,
        })?;
        // Its start takes a while; nothing is sent before it is ready.
        let mut recorder_process = recorder.start(ProcessStart::default())?;
        let change_client = ChangeClient::new(Arc::new(ChangePage::open(&directory.root())?));
        let (inject, fault_requests) = std::sync::mpsc::channel();
        let notify = Notify::from_env();
        let _operator = OperatorServer::start(operator::OperatorServerStart {
            domain: domain.clone(),
            run: directory.prefix().trim_end_matches('_').to_owned(),
            scenario: request.scenario.clone(),
            clock: request.clock,
            log: request.log.clone(),
            ticks: settings.duration_ticks as i64,
            initial: hapfic_config::ParameterSettings {
                target_position: settings.initial.target_position.or(Some(start.position)),
                rotation: settings.initial.rotation.map(|rotation| hapfic_config::RotationSettings {
                    target_orientation: rotation.target_orientation.or(Some(start.rpy)),
                    ..rotation
                }),
                ..settings.initial
            },
            change_client,
            inject,
            standby: settings.supervisor.standby,
            shared: Arc::clone(&shared),
            latest: Arc::clone(&latest),
            root: root.clone(),
            advisor,
        })?;
        let ready_timeout = Duration::from_millis(settings.supervisor.ready_timeout_ms.into());
        recorder::await_ready(&mut recorder_process, &shared.heartbeats, ready_timeout)?;

        preflight::reserve_segments(&directory.prefix())?;
        let mut watch = Watch::open(
            &bus,
            WatchStart {
                request,
                shared: Arc::clone(&shared),
                recorder: (&recorder, recorder_process),
                gates: &gates,
                latest,
                stop,
                prefix: directory.prefix(),
                run_file: &run_file,
                cores,
                fault_requests,
                notify: &notify,
            },
        )?;
        let times = match watch.start_and_follow() {
            Ok(times) => times,
            // Processes may run by now, so a failure must end them.
            Err(e) => {
                watch.fault("supervisor", format!("{e:#}"), Detector::Start);
                RunTimes::default()
            }
        };
        watch.end(times.completed)?;
        let faults = std::mem::take(&mut watch.faults);
        let (losses, supervisor_delay) = (watch.losses(), watch.largest_delay());
        let recorder_end = watch.take_recorder();
        drop(watch);
        let recorded = recorder.finish(recorder_end);
        let own = OwnCounts { gate: shared.gate.counts(), supervisor_delay };
        Ok(summarise(request, times, faults, losses, own, recorded, log_id))
    }
}

/// Adds a hint to the error of a plant whose start posture looks like degrees.
fn with_degrees(error: PlantError, settings: &Settings) -> anyhow::Error {
    match degrees_hint(&settings.robot.start_position) {
        Some(hint) => anyhow::anyhow!("{error}. Hint: {hint}"),
        None => error.into(),
    }
}

/// Size of the file table: a supervisor has some 250 files open with all processes connected, and more after restarts.
const FD_TABLE_SIZE: u64 = 1024;
/// Largest log of a killed run that a start recovers automatically [bytes]: about 1 s of work.
const AUTO_RECOVERY_LIMIT: u64 = 64 << 20;

/// Recovers the log of a run whose supervisor was killed, and reports it; a failure does not prevent the start.
fn recover_orphan(log: &Path) {
    // Of a log in parts the last one is cut off.
    let last = hapfic_log::parts(log).pop();
    let log = last.as_deref().unwrap_or(log);
    // Reading a pipe would block until a writer opens it.
    let Some(metadata) = std::fs::metadata(log).ok().filter(std::fs::Metadata::is_file) else { return };
    if metadata.len() > AUTO_RECOVERY_LIMIT {
        crate::log_line(&format!("hapfic: a run was killed. Hint: `hapfic recover {}` makes its log readable", log.display()));
        return;
    }
    match hapfic_log::recover(log, None) {
        Ok(recovery) => {
            if let Some(output) = &recovery.output {
                crate::log_line(&format!("hapfic: a run was killed; its log is recovered to {}", output.display()));
            }
        }
        Err(e) => crate::log_line(&format!("hapfic: a run was killed, and its log cannot be recovered: {e}")),
    }
}

fn keep_all_alive(bus: &Bus) -> Result<Vec<Box<dyn std::any::Any>>> {
    Ok(vec![
        bus.keep_alive(&topic::STATE)?,
        bus.keep_alive(&topic::REFERENCE)?,
        bus.keep_alive(&topic::REQUEST)?,
        bus.keep_alive(&topic::COMMAND)?,
        bus.keep_alive(&topic::OPERATOR)?,
        bus.keep_alive(&topic::EVENT)?,
        bus.keep_alive(&topic::TIMING)?,
        bus.keep_alive(&topic::CREDIT)?,
        bus.keep_alive(&topic::INJECTION)?,
        bus.keep_alive(&topic::view::STATE)?,
        bus.keep_alive(&topic::view::REFERENCE)?,
        bus.keep_alive(&topic::view::REQUEST)?,
        bus.keep_alive(&topic::view::COMMAND)?,
        bus.keep_alive(&topic::view::OPERATOR)?,
        bus.keep_alive(&topic::view::EVENT)?,
        bus.keep_alive(&topic::view::TIMING)?,
        hapfic_ipc::service::keep_alive(bus)?,
    ])
}

fn run_log<'a>(request: &'a RunRequest, plant: &'a Plant, start_unix_ns: u64) -> RunLog<'a> {
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

/// Counts of the gate and of the main thread.
struct OwnCounts {
    gate: GateCounts,
    supervisor_delay: Duration,
}

/// Identity of a file: device and inode.
type FileId = (u64, u64);

/// Returns the identity of the file at a path; `None` without a file.
fn file_id(path: &Path) -> Option<FileId> {
    std::fs::metadata(path).ok().map(|metadata| (metadata.dev(), metadata.ino()))
}

/// Describes what has become of a log that was created as `created`.
fn log_problem(log: &Path, created: Option<FileId>) -> Option<String> {
    match file_id(log) {
        None => Some("was deleted during the run: its content is lost".to_owned()),
        now if now != created => Some("was replaced during the run: the file of this name is another".to_owned()),
        _ => None,
    }
}

fn summarise(
    request: &RunRequest,
    times: RunTimes,
    mut faults: Vec<RunFault>,
    losses: Losses,
    own: OwnCounts,
    recorded: RecordingOutcome,
    log_id: Option<FileId>,
) -> Summary {
    let RecordingOutcome { figures: recorded, incidents, tasks, error } = recorded;
    let mut completed = times.completed && faults.is_empty();
    let mut unlogged = None;
    if let (Some(error), OnFailure::Continue) = (&error, request.settings.recorder.on_failure) {
        unlogged = Some(format!("ended early: {error}"));
    } else if let Some(error) = error {
        completed = false;
        faults.push(RunFault {
            process: "recorder".to_owned(),
            what: error,
            detector: Detector::Recorder,
            tick: recorded.and_then(|r| r.metrics.ticks.last).unwrap_or(-1),
        });
    }
    if completed && recorded.is_some_and(|r| !r.active) {
        completed = false;
        let what = "made no valid request in the whole run".to_owned();
        faults.push(RunFault { process: "controller".to_owned(), what, detector: Detector::Tick, tick: -1 });
    }
    let metrics = recorded.map(|r| r.metrics).unwrap_or_default();
    let run = RunSummary {
        scenario: request.scenario.clone(),
        clock: request.clock.name(),
        wall_s: times.wall_s,
        launch_s: times.launch_s,
        completed,
        steal_ms: times.steal_ms,
        gate: own.gate,
        discontinuity_n_m: request.settings.supervisor.discontinuity,
        supervisor_delay: own.supervisor_delay,
        losses,
        incidents,
        faults,
        tasks,
        log: request.log.clone(),
    };
    let mut lost = metrics.ticks.lost;
    if times.completed && metrics.ticks.last.is_some() {
        // Gaps, and ticks missing at the start and at the end.
        let written = recorded.map_or(0, |r| r.ticks[0].min(r.ticks[1]));
        lost = request.settings.duration_ticks.saturating_sub(written);
    }
    let log = RecorderSummary {
        messages: recorded.map_or(0, |r| r.messages),
        lost,
        file_bytes: recorded.map_or(0, |r| r.file_bytes),
        parts: recorded.map_or(1, |r| r.parts[0]),
        removed_parts: recorded.map_or(0, |r| r.parts[1]),
        problem: unlogged.or_else(|| log_problem(&request.log, log_id)),
    };
    Summary::new(run, &metrics, log)
}
