//! The launcher: checks a run, starts its supervisor, and another one when that is lost.
//!
//! It does nothing else while the run lasts, so nothing but a signal can end it. It is the parent of what a lost supervisor
//! leaves behind (`PR_SET_CHILD_SUBREAPER`), and holds what belongs to a run and not to one of its processes: the
//! registration, the locked log, the latency request to the processor.

use crate::children::{self, describe, has_ended};
use crate::notify::Notify;
use crate::preflight;
use crate::privileges::{self, Cores};
use crate::reaper;
use crate::registry::{self, RunDirectory};
use crate::request::RunRequest;
use crate::supervise::RunResult;
use crate::watch::{self, WATCH_PRIORITY};
use anyhow::{Context, Result};
use hapfic_config::Settings;
use hapfic_controller::parameters::TipPose;
use hapfic_gate::restart_policy::{RestartAction, RestartPolicy, RestartSignal, RestartStage, RestartState};
use hapfic_ipc::realtime::{CpuLatencyGuard, set_own_priority_of};
use hapfic_ipc::run_status::SharedStatus;
use hapfic_ipc::{ProcessStart, RunFile, SupervisorPage};
use hapfic_log::{LogFile, RunLog};
use hapfic_messages::{Clock, Process, RealtimeMode};
use hapfic_plant::{Plant, PlantError};
use hapfic_simulation::findings::{Advisor, degrees_hint};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Pid, PidfdFlags, Signal, kill_process, pidfd_open, set_child_subreaper};
use signal_hook::iterator::Signals;
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Interval at which the launcher looks for signals and for ended processes.
const LOOK_INTERVAL: Duration = Duration::from_millis(100);

/// Interval at which the launcher reaps the processes that a lost supervisor has left behind.
const ORPHANS_INTERVAL: Duration = Duration::from_secs(1);

/// An invalid run request; no process was started.
#[derive(Debug)]
pub struct InvalidRequest(pub anyhow::Error);

/// Runs a scenario. `None`: the run has failed without a summary, and its supervisor or the launcher has said why.
///
/// # Errors
/// `Ok(Err(InvalidRequest))` if the request is invalid; `Err` if the launcher itself fails.
pub fn run(request: &RunRequest) -> Result<Result<Option<RunResult>, InvalidRequest>> {
    let prepared = match PreparedRun::new(request) {
        Ok(prepared) => prepared,
        Err(e) => return Ok(Err(InvalidRequest(e))),
    };
    prepared.run(request).map(Ok)
}

/// A checked request, with every resource that an invalid request can make fail.
struct PreparedRun {
    directory: RunDirectory,
    /// Position and orientation of the tip at the start.
    start_pose: [[f64; 3]; 2],
    /// The created log.
    log: LogFile,
    start_unix_ns: u64,
    requests: EndRequests,
}

/// Signals that end the run: the first one in order, the second one without its supervisor, the third one immediately.
struct EndRequests {
    signals: Signals,
    count: usize,
    /// Whether the next signal ends the launcher.
    last: Arc<AtomicBool>,
}

impl EndRequests {
    fn new() -> std::io::Result<Self> {
        const SIGNALS: [i32; 3] = [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP];
        let last = Arc::new(AtomicBool::new(false));
        for signal in SIGNALS {
            signal_hook::flag::register_conditional_shutdown(signal, 3, Arc::clone(&last))?;
        }
        Ok(Self { signals: Signals::new(SIGNALS)?, count: 0, last })
    }

    /// Number of signals so far.
    fn count(&mut self) -> usize {
        self.count += self.signals.pending().count();
        self.last.store(self.count > 1, Ordering::Relaxed);
        self.count
    }
}

/// End of a supervisor.
enum SupervisorEnd {
    /// It has ended: how.
    Ended(String),
    /// A second signal has ended it.
    Forced,
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
        let requests = EndRequests::new().context("cannot handle signals")?;
        // A scenario may intend what they describe.
        advisor.scenario().iter().for_each(|finding| crate::log_line(&finding.to_string()));
        let start = TipPose::of(&plant.chain().kinematics(&plant.sample().joint_position));
        Ok(Self { directory, start_pose: [start.position, start.rpy], log, start_unix_ns, requests })
    }

    fn run(mut self, request: &RunRequest) -> Result<Option<RunResult>> {
        let settings = &request.settings;
        let root = self.directory.root();
        let realtime = request.clock == Clock::Realtime && request.realtime != RealtimeMode::Off;
        let fifo = realtime && hapfic_ipc::realtime::may_fifo(settings.realtime.priority_plant as i32);
        let cores = Cores::new(&settings.realtime, self.directory.others(), fifo);
        let run_file = Path::new(&root).join("run.json");
        let age_ns = u64::try_from(request.since.elapsed().as_nanos()).unwrap_or(0);
        RunFile {
            prefix: self.directory.prefix(),
            root: root.clone(),
            scenario: request.scenario.clone(),
            log: std::path::absolute(&request.log).unwrap_or_else(|_| request.log.clone()),
            log_name: request.log.clone(),
            start_unix_ns: self.start_unix_ns,
            launcher_pid: std::process::id() as i32,
            launched_ns: hapfic_ipc::clock::now_ns().saturating_sub(age_ns),
            clock: request.clock,
            realtime: request.realtime,
            core: cores.shared,
            standby_core: cores.reserve,
            gate_core: cores.gate,
            gate_busy_polls: cores.gate_busy_polls,
            spare_core: cores.spare,
            start_pose: self.start_pose,
            settings: settings.effective_toml(),
            urdf_name: settings.robot.urdf.name.clone(),
            urdf: settings.robot.urdf.text.clone(),
        }
        .write(&run_file)?;
        let _idle = if realtime { CpuLatencyGuard::take() } else { None };
        set_child_subreaper(Some(rustix::process::getpid())).context("cannot take over what a lost supervisor leaves behind")?;
        reaper::start()?;
        let status = SharedStatus::create(&root)?;
        let page = SupervisorPage::open(&root)?;
        let policy = RestartPolicy {
            budget: settings.supervisor.restart_budget,
            window_ms: settings.supervisor.restart_window_ms.into(),
            backoff_ms: settings.supervisor.restart_backoff_ms.into(),
        };
        let begun = Instant::now();
        let mut restart = RestartState::at(RestartStage::Working);
        let mut start = ProcessStart::default();
        loop {
            let end = match self.supervise(&run_file, start, &page, realtime) {
                Ok(end) => end,
                Err(e) if start.generation == 0 => return Err(e),
                // Out of memory or processes: handled as one that ends immediately.
                Err(e) => SupervisorEnd::Ended(format!("cannot be started: {e:#}")),
            };
            // It may have been lost behind it.
            if let Some(result) = RunResult::read(Path::new(&root)) {
                return Ok(Some(result));
            }
            let started = status.orders.start.load(Ordering::Acquire);
            let action;
            (restart, action) = restart.after(RestartSignal::Lost, begun.elapsed().as_millis() as u64, &policy);
            match end {
                SupervisorEnd::Forced => crate::log_line("hapfic: the second signal ends the run without its supervisor"),
                SupervisorEnd::Ended(what) if !started => {
                    crate::log_line(&format!("hapfic: the supervisor {what} before the run began"))
                }
                SupervisorEnd::Ended(what) if action == Some(RestartAction::Stop) => {
                    let number = restart.restarts();
                    crate::log_line(&format!("hapfic: the supervisor {what} once more after {number} restarts: the run ends"));
                }
                SupervisorEnd::Ended(_) => {
                    if let RestartStage::BackOff(at_ms) = restart.stage {
                        std::thread::sleep(Duration::from_millis(at_ms).saturating_sub(begun.elapsed()));
                    }
                    (restart, _) = restart.after(RestartSignal::Time, begun.elapsed().as_millis() as u64, &policy);
                    start.generation += 1;
                    continue;
                }
            }
            self.give_up(&page, request);
            return Ok(None);
        }
    }

    /// Starts a supervisor, and waits for its end. Its standard input is the log, its standard output the registration: it
    /// shares their locks.
    fn supervise(
        &mut self,
        run_file: &Path,
        start: ProcessStart,
        page: &SupervisorPage,
        realtime: bool,
    ) -> Result<SupervisorEnd> {
        let mut command = children::this_program()?;
        children::mark(&mut command, Process::Supervisor, run_file, start);
        Notify::pass_on(&mut command);
        let spawned = command
            .args(["process", "supervisor"])
            .process_group(0)
            .stdin(Stdio::from(self.log.handle()?))
            .stdout(Stdio::from(self.directory.handle()?))
            .spawn()
            .context("cannot start the supervisor")?;
        let pid = Pid::from_child(&spawned);
        // However long its start takes, it owns the run.
        page.pid.store(pid.as_raw_nonzero().get(), Ordering::Release);
        if realtime && start.generation > 0 {
            // The others wait for it; without the privilege it waits for a processor.
            let _ = set_own_priority_of(pid, WATCH_PRIORITY);
        }
        let handle = match pidfd_open(pid, PidfdFlags::empty()) {
            Ok(handle) => handle,
            Err(e) => {
                let _ = kill_process(pid, Signal::KILL);
                return Err(e).context("cannot watch the supervisor");
            }
        };
        let mut told = false;
        let mut orphans_looked = Instant::now();
        loop {
            match self.requests.count() {
                0 => {}
                // Not before it handles signals.
                1 if told || !page.has_begun(start.generation) => {}
                1 => {
                    told = true;
                    // Fails only if it has ended.
                    let _ = kill_process(pid, Signal::TERM);
                    let _ = kill_process(pid, Signal::CONT);
                }
                _ => {
                    let _ = kill_process(pid, Signal::KILL);
                    return Ok(SupervisorEnd::Forced);
                }
            }
            pause(&handle);
            match reaper::exit_status(pid) {
                Ok(Some(status)) => return Ok(SupervisorEnd::Ended(describe(status))),
                // The one that has started this program has told the kernel to reap its children.
                Err(_) if has_ended(&handle) => return Ok(SupervisorEnd::Ended("ended".to_owned())),
                Ok(None) | Err(_) => {}
            }
            if orphans_looked.elapsed() >= ORPHANS_INTERVAL {
                reaper::reap_orphans();
                orphans_looked = Instant::now();
            }
        }
    }

    /// Ends a run that has no supervisor any more.
    fn give_up(&self, page: &SupervisorPage, request: &RunRequest) {
        // A service manager waits for its heartbeats no longer.
        Notify::from_env().stopping();
        registry::end_in_order(self.directory.prefix().trim_end_matches('_'));
        if page.filled.load(Ordering::Relaxed) != 0 {
            let _ = std::fs::remove_file(request.log.with_extension("filler"));
        }
        crate::log_line(&format!("hapfic: the run has no summary; its log is {}", request.log.display()));
    }
}

/// Waits until a process ends, or for a moment.
fn pause(handle: &OwnedFd) {
    // An interrupted wait equals a time-out: the caller checks everything anyway.
    let _ = poll(&mut [PollFd::new(handle, PollFlags::IN)], Some(&hapfic_ipc::clock::timespec(LOOK_INTERVAL.as_nanos() as u64)));
}

/// Adds a hint to the error of a plant whose start posture looks like degrees.
fn with_degrees(error: PlantError, settings: &Settings) -> anyhow::Error {
    match degrees_hint(&settings.robot.start_position) {
        Some(hint) => anyhow::anyhow!("{error}. Hint: {hint}"),
        None => error.into(),
    }
}

/// Largest log of a killed run that a start recovers automatically [bytes]: about 1 s of work.
const AUTO_RECOVERY_LIMIT: u64 = 64 << 20;

/// Recovers the log of a run that was killed, and reports it; a failure does not prevent the start.
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
