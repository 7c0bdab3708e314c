//! The process of the supervisor: joins a run that the launcher has prepared, begins it or takes it over, and leaves its result.

use crate::latest::LatestMessages;
use crate::notify::Notify;
use crate::operator::{self, OperatorServer};
use crate::preflight;
use crate::privileges::Cores;
use crate::reaper;
use crate::recorder::{self, Recorder, RecorderStart, RecordingOutcome};
use crate::registry::{self, RunDirectory};
use crate::request::RunRequest;
use crate::summary::{Losses, RecorderSummary, RunFault, RunSummary, Summary};
use crate::watch::{DeadNodes, RunTimes, Watch, WatchStart};
use anyhow::{Context, Result, ensure};
use hapfic_config::{OnFailure, Settings};
use hapfic_gate_process::change_exchange::ChangeClient;
use hapfic_ipc::realtime::Prefault;
use hapfic_ipc::run_status::{GateCounts, SharedStatus};
use hapfic_ipc::{Bus, ChangePage, Domain, GatePage, ProcessStart, RunFile, SupervisorPage, clock};
use hapfic_log::LogFile;
use hapfic_messages::{Clock, Detector, Process, RealtimeMode};
use hapfic_simulation::findings::Advisor;
use rustix::process::{Signal, getppid, set_parent_process_death_signal};
use rustix::stdio::{dup2_stdin, dup2_stdout};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::os::fd::AsFd;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// Result of a run, which the supervisor leaves for the launcher in the run's folder.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunResult {
    /// Whether the run reached its end.
    pub completed: bool,
    /// The summary as text.
    pub text: String,
    /// The summary as JSON.
    pub json: String,
}

impl RunResult {
    fn path(root: &Path) -> PathBuf {
        root.join("result.json")
    }

    fn of(summary: &Summary) -> Result<Self> {
        let json = serde_json::to_string_pretty(summary)?;
        Ok(Self { completed: summary.completed, text: summary.text(), json })
    }

    fn write(&self, root: &Path) -> Result<()> {
        recorder::replace(&Self::path(root), &serde_json::to_vec(self)?).context("cannot leave the result of the run")
    }

    /// The result of a run; `None` if its supervisor has left none.
    pub(crate) fn read(root: &Path) -> Option<Self> {
        serde_json::from_slice(&std::fs::read(Self::path(root)).ok()?).ok()
    }
}

/// Supervises a run to its end. Standard input is the created log, standard output the run's registration. Returns whether
/// the run has completed.
///
/// # Errors
/// If the run cannot be joined, or the supervisor itself fails.
pub fn run(run: &RunFile, run_file: &Path, settings: Settings, start: ProcessStart) -> Result<bool> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).context("cannot handle signals")?;
    }
    rustix::thread::set_name(c"hapfic-watch").context("cannot set the process's name")?;
    // A table that grows during the run delays a tick. Before the first thread: threads that share it wait, on a loaded
    // machine for seconds.
    let _ = hapfic_ipc::realtime::reserve_fd_table(FD_TABLE_SIZE);
    reaper::start()?;
    // Wakes a halted supervisor: without the launcher it ends the run.
    set_parent_process_death_signal(Some(Signal::CONT)).context("cannot join the run")?;
    let launcher_lives = || getppid().is_some_and(|parent| parent.as_raw_nonzero().get() == run.launcher_pid);
    ensure!(launcher_lives(), "cannot join the run: its launcher has ended");
    let registration = std::io::stdout().as_fd().try_clone_to_owned().context("cannot share the registration")?;
    let log = std::io::stdin().as_fd().try_clone_to_owned().context("cannot take the log")?;
    let null = File::options().read(true).write(true).open("/dev/null").context("cannot open /dev/null")?;
    // What writes to standard output by mistake must not reach the registration.
    dup2_stdin(&null).and_then(|()| dup2_stdout(&null)).context("cannot close the standard streams")?;
    let record = SupervisorPage::open(&run.root)?;
    let last_ns = record.begin(start.generation, clock::now_ns());
    ensure!(last_ns.is_some() == (start.generation > 0), "cannot join the run: it has a supervisor");
    let age = Duration::from_nanos(clock::now_ns().saturating_sub(run.launched_ns));
    let request = RunRequest {
        scenario: run.scenario.clone(),
        settings,
        clock: run.clock,
        realtime: run.realtime,
        log: run.log_name.clone(),
        since: Instant::now().checked_sub(age).unwrap_or_else(Instant::now),
    };
    let log = File::from(log);
    let log_id = log.metadata().ok().map(|metadata| (metadata.dev(), metadata.ino()));
    let log = LogFile::shared(&run.log_name, log)?;
    let result = supervise(&request, run, run_file, (&record, last_ns), (log, log_id), stop)?;
    if !launcher_lives() {
        // Nobody else prints it, and removes the run.
        crate::log_line(result.text.trim_end());
        drop(RunDirectory::taken_over(&run.prefix, File::from(registration))?);
    }
    Ok(result.completed)
}

/// Begins the run, or goes on behind a lost supervisor, whose last heartbeat was at `last_ns`.
fn supervise(
    request: &RunRequest,
    run: &RunFile,
    run_file: &Path,
    (record, last_ns): (&SupervisorPage, Option<u64>),
    (log, log_id): (LogFile, Option<FileId>),
    stop: Arc<AtomicBool>,
) -> Result<RunResult> {
    let settings = &request.settings;
    hapfic_ipc::service::silence_transport_log();
    let domain = Domain::new(&run.prefix, &run.root)?.with_short_timeouts(request.clock);
    let realtime = request.clock == Clock::Realtime && request.realtime != RealtimeMode::Off;
    let advisor = Advisor::new(settings)?;
    if realtime {
        hapfic_ipc::realtime::lock_memory(Prefault::All);
    }
    let mut dead_nodes = DeadNodes::new(&run.prefix)?;
    if last_ns.is_some() {
        dead_nodes.clean_up_predecessor(run_file, None);
    }
    // The supervisor creates all services and keeps them: a creator that dies midway can make a service unusable.
    let bus = Bus::open(&domain, "supervisor")?;
    if last_ns.is_none() {
        registry::close_to_others(&run.prefix)?;
    }
    let _services = bus.keep_all_alive()?;
    let shared = Arc::new(SharedStatus::open(&run.root)?);
    let latest = Arc::new(LatestMessages::default());
    let root = Path::new(&run.root).to_owned();
    let gates = if last_ns.is_none() { GatePage::create(&run.root)? } else { GatePage::open(&run.root)? };
    let recorder = Recorder::new(RecorderStart {
        root: root.clone(),
        clock: request.clock,
        settings,
        run_file,
        log: &request.log,
        file: log,
    })?;
    // Its start takes a while; nothing is sent before it is ready.
    let mut recorder_process = match last_ns {
        None => Some(recorder.start(ProcessStart::default())?),
        Some(_) => None,
    };
    if let Some(child) = &recorder_process {
        record.process(Process::Recorder).set_pid(Some(child.pid().as_raw_nonzero().get()));
    }
    let change_client = ChangeClient::new(Arc::new(ChangePage::open(&run.root)?));
    let (inject, fault_requests) = std::sync::mpsc::channel();
    let notify = Notify::from_env();
    let [position, rpy] = run.start_pose;
    if let Some(child) = &mut recorder_process {
        let ready_timeout = Duration::from_millis(settings.supervisor.ready_timeout_ms.into());
        recorder::await_ready(child, &shared.heartbeats, ready_timeout)?;
        preflight::reserve_segments(&run.prefix)?;
    }
    let mut watch = Watch::open(
        &bus,
        WatchStart {
            request,
            shared: Arc::clone(&shared),
            recorder: (&recorder, recorder_process),
            record,
            dead_nodes,
            launcher_pid: run.launcher_pid,
            gates: &gates,
            latest: Arc::clone(&latest),
            stop,
            prefix: run.prefix.clone(),
            root: root.clone(),
            run_file,
            cores: Cores {
                shared: run.core,
                reserve: run.standby_core,
                gate: run.gate_core,
                gate_busy_polls: run.gate_busy_polls,
                spare: run.spare_core,
            },
            fault_requests,
            notify: &notify,
        },
    )?;
    // The answers of the server are about the present sets.
    watch.receive_latest()?;
    let operator = OperatorServer::start(operator::OperatorServerStart {
        domain: domain.clone(),
        run: run.prefix.trim_end_matches('_').to_owned(),
        scenario: request.scenario.clone(),
        clock: request.clock,
        log: request.log.clone(),
        ticks: settings.duration_ticks as i64,
        initial: hapfic_config::ParameterSettings {
            target_position: settings.initial.target_position.or(Some(position)),
            rotation: settings.initial.rotation.map(|rotation| hapfic_config::RotationSettings {
                target_orientation: rotation.target_orientation.or(Some(rpy)),
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
    });
    let _operator = match operator {
        Ok(operator) => Some(operator),
        // A successor goes on without it.
        Err(e) if last_ns.is_some() => {
            crate::log_line(&format!("hapfic: the run goes on without the operator's commands: {e:#}"));
            None
        }
        Err(e) => return Err(e),
    };
    let followed = match last_ns {
        None => watch.start_and_follow(),
        Some(last_ns) => watch.take_over_and_follow(last_ns),
    };
    let times = match followed {
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
    let result = RunResult::of(&summarise(request, times, faults, losses, own, recorded, log_id))?;
    // Before the services end: a supervisor that is lost while it ends them leaves them unusable for a successor.
    if let Err(e) = result.write(&root) {
        crate::log_line(result.text.trim_end());
        return Err(e);
    }
    Ok(result)
}

/// Size of the file table: a supervisor has some 250 files open with all processes connected, and more after restarts.
const FD_TABLE_SIZE: u64 = 1024;
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
