//! The launcher: checks a run, starts its supervisor, and another one when that is lost.
//!
//! It does nothing else while the run lasts, so nothing but a signal can end it. It is the parent of what a lost supervisor
//! leaves behind (`PR_SET_CHILD_SUBREAPER`), and holds what belongs to a run and not to one of its processes: the
//! registration, the locked log, the latency request to the processor.

use crate::children::{self, describe};
use crate::notify::Notify;
use crate::preflight;
use crate::privileges::{self, Cores};
use crate::registry::RunDirectory;
use crate::request::RunRequest;
use crate::supervise::RunResult;
use crate::watch;
use anyhow::{Context, Result};
use hapfic_config::Settings;
use hapfic_controller::parameters::TipPose;
use hapfic_ipc::realtime::CpuLatencyGuard;
use hapfic_ipc::run_status::SharedStatus;
use hapfic_ipc::{ProcessStart, RecorderPage, RunFile, SupervisorPage};
use hapfic_log::{LogFile, RunLog};
use hapfic_messages::{Clock, Detector, Process, RealtimeMode};
use hapfic_plant::{Plant, PlantError};
use hapfic_simulation::findings::{Advisor, degrees_hint};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Pid, PidfdFlags, Signal, WaitOptions, kill_process, pidfd_open, set_child_subreaper, wait};
use std::os::fd::OwnedFd;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Interval at which the launcher looks for signals and for ended processes.
const LOOK_INTERVAL: Duration = Duration::from_millis(100);
/// Exit code of a supervisor that has panicked: its successor goes on.
const PANICKED: i32 = 101;
/// Time in which the gates let the drive brake before a run without a supervisor ends.
const BRAKE_TIME: Duration = Duration::from_millis(300);
/// Time that the processes of such a run, and then its recorder, may take to end.
const END_TIMEOUT: Duration = Duration::from_secs(2);
const RECORDER_TIMEOUT: Duration = Duration::from_secs(10);

/// An invalid run request; no process was started.
#[derive(Debug)]
pub struct InvalidRequest(pub anyhow::Error);

/// Runs a scenario. `None`: the run has failed without a summary, and its supervisor has said why.
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
            // The second signal ends the launcher immediately; the supervisor then brakes and ends the run.
            signal_hook::flag::register_conditional_shutdown(signal, 3, Arc::clone(&stop)).context("cannot handle signals")?;
            signal_hook::flag::register(signal, Arc::clone(&stop)).context("cannot handle signals")?;
        }
        // A scenario may intend what they describe.
        advisor.scenario().iter().for_each(|finding| crate::log_line(&finding.to_string()));
        let start = TipPose::of(&plant.chain().kinematics(&plant.sample().joint_position));
        Ok(Self { directory, start_pose: [start.position, start.rpy], log, start_unix_ns, stop })
    }

    fn run(self, request: &RunRequest) -> Result<Option<RunResult>> {
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
        let status = SharedStatus::create(&root)?;
        let mut losses: Vec<Instant> = Vec::new();
        loop {
            let start = ProcessStart { generation: losses.len() as u32 };
            let end = self.supervise(&run_file, start)?;
            let what = match end.code() {
                Some(code) if code != PANICKED => return Ok(RunResult::read(Path::new(&root))),
                _ => describe(end),
            };
            let window = Duration::from_millis(settings.supervisor.restart_window_ms.into());
            let recent = losses.iter().filter(|at| at.elapsed() < window).count();
            losses.push(Instant::now());
            if !status.orders.start.load(Ordering::Acquire) {
                crate::log_line(&format!("hapfic: the supervisor {what} before the run began"));
            } else if recent >= settings.supervisor.restart_budget as usize {
                crate::log_line(&format!("hapfic: the supervisor {what} once more after {recent} restarts: the run ends"));
            } else {
                continue;
            }
            self.give_up(&status, &root);
            crate::log_line(&format!("hapfic: the run has no summary; its log is {}", request.log.display()));
            return Ok(None);
        }
    }

    /// Starts a supervisor, and waits for its end. Its standard input is the log, its standard output the registration: it
    /// shares their locks.
    fn supervise(&self, run_file: &Path, start: ProcessStart) -> Result<ExitStatus> {
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
        let handle = pidfd_open(pid, PidfdFlags::empty()).context("cannot watch the supervisor")?;
        let mut told = false;
        loop {
            if self.stop.load(Ordering::Relaxed) && !std::mem::replace(&mut told, true) {
                // Fails only if it has ended.
                let _ = kill_process(pid, Signal::TERM);
                let _ = kill_process(pid, Signal::CONT);
            }
            pause(&handle);
            // Also the processes that a lost supervisor has left behind.
            while let Ok(Some((ended, status))) = wait(WaitOptions::NOHANG) {
                if ended == pid {
                    return Ok(ExitStatus::from_raw(status.as_raw()));
                }
            }
        }
    }

    /// Ends a run that has no supervisor any more: lets the drive brake, ends the processes, and lets the recorder finish.
    fn give_up(&self, status: &SharedStatus, root: &str) {
        let started = status.orders.start.load(Ordering::Acquire);
        if started {
            status.orders.stop_latched(Detector::Exit);
            std::thread::sleep(BRAKE_TIME);
        }
        status.orders.stop.store(true, Ordering::Release);
        let (Ok(page), Ok(recorder)) = (SupervisorPage::open(root), RecorderPage::open(root)) else { return };
        let noted = |process: &Process| page.process(*process).pid().and_then(Pid::from_raw);
        let others: Vec<Pid> = Process::ALL.iter().filter(|process| **process != Process::Recorder).filter_map(noted).collect();
        for pid in &others {
            let _ = kill_process(*pid, Signal::TERM);
            let _ = kill_process(*pid, Signal::CONT);
        }
        await_end(&others, END_TIMEOUT);
        recorder.order_drain();
        await_end(&noted(&Process::Recorder).into_iter().collect::<Vec<_>>(), RECORDER_TIMEOUT);
    }
}

/// Waits until a process ends, or for a moment.
fn pause(handle: &OwnedFd) {
    // An interrupted wait equals a time-out: the caller checks everything anyway.
    let _ = poll(&mut [PollFd::new(handle, PollFlags::IN)], Some(&hapfic_ipc::clock::timespec(LOOK_INTERVAL.as_nanos() as u64)));
}

/// Waits until child processes have ended, at most for a time.
fn await_end(pids: &[Pid], timeout: Duration) {
    let begun = Instant::now();
    let mut left = pids.to_vec();
    while !left.is_empty() && begun.elapsed() < timeout {
        while let Ok(Some((ended, _))) = wait(WaitOptions::NOHANG) {
            left.retain(|pid| *pid != ended);
        }
        left.retain(|pid| rustix::process::test_kill_process(*pid).is_ok());
        std::thread::sleep(Duration::from_millis(2));
    }
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
