//! The operator server: a thread that answers the requests of operators.

use super::change::Consent;
use super::status::{LatencyQuantiles, ProcessStatus, Status};
use crate::latest::LatestMessages;
use crate::log_line;
use crate::recorder;
use crate::watch;
use anyhow::{Context, Result};
use hapfic_config::{Fault, PERIOD_S, ParameterSettings};
use hapfic_gate_process::change_exchange::ChangeClient;
use hapfic_ipc::run_status::{Presence, SharedStatus};
use hapfic_ipc::service::{PendingRequest, RequestServer};
use hapfic_ipc::{Bus, Domain, IpcError, wait};
use hapfic_messages::{Clock, Detector, Mode, OperatorKind, OperatorReply, Phase, Process, REPLY_TEXT, ReplyCode, Severity};
use hapfic_simulation::findings::Advisor;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Longest wait for a request before the thread polls.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Time the gate may take to accept a change. The gate polls every tick, so a longer wait means that no tick is done.
pub(super) const GATE_TIMEOUT: Duration = Duration::from_millis(500);
/// Interval between two clean-ups of dead clients when there are many.
const CLEAN_UP_INTERVAL: Duration = Duration::from_secs(1);

/// Processes whose status is reported.
const REPORTED_PROCESSES: [Process; 7] = [
    Process::Plant,
    Process::Planner,
    Process::Controller,
    Process::Standby,
    Process::Gate,
    Process::SpareGate,
    Process::Recorder,
];

/// Arguments of [`OperatorServer::start`].
#[derive(Debug)]
pub struct OperatorServerStart {
    /// Domain of the run.
    pub domain: Domain,
    /// Name of the run.
    pub run: String,
    /// Name of the scenario.
    pub scenario: String,
    /// Clock of the run.
    pub clock: Clock,
    /// Path of the log.
    pub log: PathBuf,
    /// Ticks of the run.
    pub ticks: i64,
    /// Initial parameters, target included.
    pub initial: ParameterSettings,
    /// Channel of parameter changes to the gate.
    pub change_client: ChangeClient,
    /// Channel of requested faults to the main thread.
    pub inject: Sender<Fault>,
    /// Whether the run has a standby controller.
    pub standby: bool,
    /// Status shared with the other threads of the supervisor.
    pub shared: Arc<SharedStatus>,
    /// Latest messages of the run.
    pub latest: Arc<LatestMessages>,
    /// The run's folder.
    pub root: PathBuf,
    /// Robot and world, with which changes are compared.
    pub advisor: Advisor,
}

/// The running server thread; ends when dropped.
#[derive(Debug)]
pub struct OperatorServer {
    thread: Option<JoinHandle<()>>,
    end: Arc<AtomicBool>,
}

impl OperatorServer {
    /// Starts the thread; returns when clients can connect.
    ///
    /// # Errors
    /// If the thread cannot be started or its ports cannot be opened.
    pub fn start(start: OperatorServerStart) -> Result<Self> {
        let end = Arc::new(AtomicBool::new(false));
        let end_flag = Arc::clone(&end);
        let (ready, opened) = channel();
        let thread = std::thread::Builder::new()
            .name("hapfic-operator".to_owned())
            .spawn(move || {
                let ports = Bus::open(&start.domain, "operator").and_then(|bus| RequestServer::open(&bus).map(|r| (bus, r)));
                match ports {
                    Ok((_bus, requests)) => {
                        let _ = ready.send(Ok(()));
                        let base = start.initial;
                        let served = RequestHandler { start, base, version: 1 }.serve(requests, &end_flag);
                        if let Err(e) = served {
                            log_line(&format!("hapfic: the operator server has failed, the run continues without it: {e}"));
                        }
                    }
                    Err(e) => {
                        let _ = ready.send(Err(e));
                    }
                }
            })
            .context("cannot start the operator server")?;
        opened.recv().context("the operator server ended immediately")??;
        Ok(Self { thread: Some(thread), end })
    }
}

impl Drop for OperatorServer {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            // The thread logs its own errors.
            let _ = thread.join();
        }
    }
}

/// State of the server thread.
pub(super) struct RequestHandler {
    pub(super) start: OperatorServerStart,
    /// Latest known parameter set, on which the next change is made, and its version.
    pub(super) base: ParameterSettings,
    pub(super) version: u64,
}

impl RequestHandler {
    fn serve(&mut self, mut requests: RequestServer, end: &AtomicBool) -> Result<(), IpcError> {
        let mut cleaned_up = Instant::now();
        while !end.load(Ordering::Acquire) {
            wait(&[&requests], POLL_INTERVAL)?;
            while let Some(incoming) = self.next(&mut requests) {
                let arrived = self.due_tick();
                let (reply, stop) = match incoming.request.parts() {
                    Ok((OperatorKind::Set, text)) => (self.set(text, Consent::Asked), false),
                    Ok((OperatorKind::SetForced, text)) => (self.set(text, Consent::Given), false),
                    Ok((OperatorKind::SetDryRun, text)) => (self.dry_run(text), false),
                    Ok((OperatorKind::Get, text)) => (self.get(text), false),
                    Ok((OperatorKind::Status, _)) => (OperatorReply::new(ReplyCode::Done, &self.status_text()), false),
                    Ok((OperatorKind::Stop, _)) => (self.stop(), true),
                    Ok((OperatorKind::EmergencyStop, _)) => (self.emergency_stop(), false),
                    Ok((OperatorKind::Rearm, _)) => (self.rearm(), false),
                    Ok((OperatorKind::Inject, text)) => (self.inject(text), false),
                    Err(error) => {
                        self.start.shared.operator.rejected.fetch_add(1, Ordering::Relaxed);
                        let text = format!("request rejected: {error}. Hint: use the same version of hapfic as the run");
                        (OperatorReply::new(ReplyCode::Rejected, &text), false)
                    }
                };
                // Fails only if the client is gone.
                let _ = incoming.reply(&OperatorReply { arrived_tick: arrived, ..reply });
                if stop {
                    self.start.shared.operator.end_requested.store(true, Ordering::Release);
                }
            }
            if cleaned_up.elapsed() > CLEAN_UP_INTERVAL && requests.needs_clean_up() {
                self.start.shared.operator.cleanup_requested.store(true, Ordering::Release);
                cleaned_up = Instant::now();
            }
        }
        Ok(())
    }

    /// Receives the next request. The half-made connection of a killed client must not block the other clients.
    fn next(&self, requests: &mut RequestServer) -> Option<PendingRequest> {
        requests.take().unwrap_or_else(|_| {
            self.start.shared.operator.rejected.fetch_add(1, Ordering::Relaxed);
            None
        })
    }

    pub(super) fn due_tick(&self) -> i64 {
        self.start.shared.gate.tick.load(Ordering::Acquire) + 1
    }

    fn stop(&self) -> OperatorReply {
        OperatorReply::new(ReplyCode::Done, &format!("run {} ends", self.start.run))
    }

    /// Requests a latched stop and replies with its tick; the gate latches at the next tick.
    fn emergency_stop(&self) -> OperatorReply {
        let shared = &self.start.shared;
        shared.orders.stop_latched(Detector::Operator);
        if self.await_gate(|severity| severity == Severity::Stopped) {
            let tick = shared.gate.tick.load(Ordering::Acquire);
            return OperatorReply::new(
                ReplyCode::Done,
                &format!("latched stop at tick {tick}: the drive brakes until `hapfic rearm`"),
            );
        }
        OperatorReply::new(
            ReplyCode::Done,
            "latched stop requested: no tick has been done since, so the drive does not move; it takes effect with the next tick",
        )
    }

    fn rearm(&self) -> OperatorReply {
        let shared = &self.start.shared;
        if shared.gate.processed_stops.load(Ordering::Acquire) < shared.orders.latched_stops.load(Ordering::Acquire) {
            let text = "nothing re-armed: the latched stop takes effect with the next tick. Hint: re-arm after that tick";
            return OperatorReply::new(ReplyCode::Rejected, text);
        }
        if shared.gate.severity.load(Ordering::Relaxed) != Severity::Stopped.code() {
            return OperatorReply::new(ReplyCode::Rejected, "nothing to re-arm: the run is not in a latched stop");
        }
        shared.orders.rearms.fetch_add(1, Ordering::AcqRel);
        if self.await_gate(|severity| severity < Severity::Stopped) {
            let text = "re-armed: the drive brakes for 20 good ticks in a row, then the torque ramps in from the foot's present \
                        position";
            return OperatorReply::new(ReplyCode::Done, text);
        }
        OperatorReply::new(ReplyCode::Done, "re-armed: takes effect with the next tick")
    }

    fn inject(&self, text: &str) -> OperatorReply {
        let rejected = |text: &str| OperatorReply::new(ReplyCode::Rejected, text);
        let pairs: Vec<&str> = text.split('\0').filter(|pair| !pair.is_empty()).collect();
        let fault = match Fault::from_pairs(&pairs) {
            Ok(fault) => fault,
            Err(e) => return rejected(&e.to_string()),
        };
        if !self.start.shared.orders.start.load(Ordering::Acquire) {
            return rejected(
                "nothing injected: the run has not started yet, expected its first tick. Hint: try again in a moment",
            );
        }
        if let Err(e) = watch::fault_possible(&fault, &self.start.log, self.start.standby) {
            return rejected(&format!("{e:#}"));
        }
        if self.start.inject.send(fault).is_err() {
            return rejected("nothing injected: the run is ending");
        }
        OperatorReply::new(
            ReplyCode::Done,
            &format!("{}: immediately, or as soon as the process does ticks", watch::describe_fault(&fault)),
        )
    }

    /// Waits until the gate's severity is as expected, for at most [`GATE_TIMEOUT`]; returns whether it is.
    fn await_gate(&self, expected: impl Fn(Severity) -> bool) -> bool {
        let started = Instant::now();
        while started.elapsed() < GATE_TIMEOUT {
            if Severity::from_code(self.start.shared.gate.severity.load(Ordering::Acquire)).is_some_and(&expected) {
                return true;
            }
            std::thread::sleep(Duration::from_micros(500));
        }
        false
    }

    /// Formats the status as JSON, short enough for a reply.
    fn status_text(&self) -> String {
        let status = self.status();
        let text = serde_json::to_string(&status).unwrap_or_default();
        if text.len() <= REPLY_TEXT {
            return text;
        }
        // The client also has these long texts from the registration.
        let short = Status { scenario: String::new(), log: PathBuf::new(), ..status };
        serde_json::to_string(&short).unwrap_or_default()
    }

    /// Whether a process is lost and its successor does no ticks yet. A lost recorder is not missing: the run goes on.
    fn is_lost(&self, process: Process) -> bool {
        let Presence { present, .. } = &self.start.shared.presence;
        self.start.shared.presence.is_missing(process)
            || process == Process::Recorder
                && self.start.shared.orders.start.load(Ordering::Relaxed)
                && present.load(Ordering::Acquire) & (1 << process.code()) == 0
    }

    fn status(&self) -> Status {
        let shared = &self.start.shared;
        let snapshot = self.start.latest.snapshot();
        let tick = shared.gate.tick.load(Ordering::Acquire);
        let latencies = if self.start.clock == Clock::Realtime { shared.gate.latencies.sorted() } else { Vec::new() };
        Status {
            run: self.start.run.clone(),
            scenario: self.start.scenario.clone(),
            clock: self.start.clock.name().to_owned(),
            mode: Mode::from_code(shared.gate.mode.load(Ordering::Relaxed)).map_or("?", Mode::name).to_owned(),
            severity: Severity::from_code(shared.gate.severity.load(Ordering::Relaxed)).map_or("?", Severity::name).to_owned(),
            tick,
            end_tick: self.start.ticks,
            time_s: tick.max(0) as f64 * PERIOD_S,
            force_n: snapshot.foot_force,
            desired_force_n: snapshot.desired_force,
            tracking_m: snapshot.tracking,
            position_bound_m: snapshot.bound,
            parameters_version: snapshot.version,
            announced_version: shared.gate.announced.load(Ordering::Relaxed),
            latency_us: LatencyQuantiles::of(&latencies),
            primary: Process::from_code(shared.gate.primary.load(Ordering::Relaxed)).map_or("?", Process::name).to_owned(),
            processes: REPORTED_PROCESSES
                .iter()
                .filter(|process| self.start.standby || **process != Process::Standby)
                .map(|process| {
                    let heartbeat = shared.heartbeats.read(*process);
                    ProcessStatus {
                        name: process.name().to_owned(),
                        phase: if self.is_lost(*process) {
                            "lost".to_owned()
                        } else {
                            heartbeat.phase.map_or("no heartbeat", Phase::name).to_owned()
                        },
                        tick: heartbeat.tick,
                        heartbeat_age_ms: heartbeat.age_ns().map(|ns| ns as f64 * 1e-6),
                        rejected: heartbeat.rejected,
                    }
                })
                .collect(),
            late_ticks: snapshot.late,
            missed_ticks: shared.gate.missed_ticks.load(Ordering::Relaxed),
            brake_ticks: shared.gate.braked_ticks.load(Ordering::Relaxed),
            stopped_by: (shared.gate.severity.load(Ordering::Relaxed) == Severity::Stopped.code())
                .then(|| Detector::from_code(shared.orders.stop_by.load(Ordering::Relaxed)))
                .flatten()
                .map(|by| by.name().to_owned()),
            rejected_requests: shared.operator.rejected.load(Ordering::Relaxed),
            tasks: recorder::tasks(&self.start.root).into_iter().filter(|task| task.since_tick.is_some()).collect(),
            log: self.start.log.clone(),
            log_bytes: hapfic_log::parts(&self.start.log)
                .iter()
                .filter_map(|part| std::fs::metadata(part).ok())
                .map(|m| m.len())
                .sum(),
        }
    }
}
