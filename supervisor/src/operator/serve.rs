//! The thread that answers.

use super::status::{LatencyQuantiles, ProcessStatus, Status};
use crate::recorder::GATE;
use crate::say;
use crate::watch;
use anyhow::{Context, Result};
use hapfic_config::{Fault, OperatorChange, PERIOD_S, Parameters, differences};
use hapfic_gate_process::change_exchange::{ChangeClient, ChangeOutcome, ChangeReply};
use hapfic_gate_process::shared_status::SharedStatus;
use hapfic_ipc::service::{Asked, Requests};
use hapfic_ipc::{Bus, Domain, IpcError, wait};
use hapfic_messages::{Clock, Detector, Mode, OperatorKind, OperatorReply, Phase, Process, REPLY_TEXT, ReplyCode, Severity};
use std::fmt::Write;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long the thread waits at most before it looks by itself.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// How long the gate may take to take a change. It looks every tick; if it does not, no tick is done.
const GATE_PATIENCE: Duration = Duration::from_millis(500);
/// How often a change is made anew because the script was faster.
const TRIES: usize = 8;
/// How often it looks for dead callers when there are many.
const SWEEP_EVERY: Duration = Duration::from_secs(1);

/// The processes that are told of.
const STARTED: [Process; 4] = [Process::Plant, Process::Planner, Process::Controller, Process::Standby];

/// What the thread starts with.
#[derive(Debug)]
pub struct OperatorServerStart {
    /// The run's domain.
    pub domain: Domain,
    /// Name of the run.
    pub run: String,
    /// Name of the scenario.
    pub scenario: String,
    /// How time passes.
    pub clock: Clock,
    /// Where the log is.
    pub log: PathBuf,
    /// Ticks of the run.
    pub ticks: i64,
    /// The first set, its target named.
    pub initial: Parameters,
    /// The way to the gate.
    pub change_client: ChangeClient,
    /// The way to those who make faults on purpose.
    pub inject: Sender<Fault>,
    /// Whether there is a second controller.
    pub standby: bool,
    /// Shared with the rest of the supervisor.
    pub shared: Arc<SharedStatus>,
}

/// The running thread; ends when dropped.
#[derive(Debug)]
pub struct Served {
    thread: Option<JoinHandle<()>>,
    end: Arc<AtomicBool>,
}

impl Served {
    /// Starts the thread; returns when it can be asked.
    ///
    /// # Errors
    /// If the thread or its ports cannot be had.
    pub fn start(start: OperatorServerStart) -> Result<Self> {
        let end = Arc::new(AtomicBool::new(false));
        let seen = Arc::clone(&end);
        let (ready, opened) = channel();
        let thread = std::thread::Builder::new()
            .name("hapfic-operator".to_owned())
            .spawn(move || {
                let ports = Bus::open(&start.domain, "operator").and_then(|bus| Requests::open(&bus).map(|r| (bus, r)));
                match ports {
                    Ok((_bus, requests)) => {
                        let _ = ready.send(Ok(()));
                        let base = start.initial;
                        let served = Desked { start, base, version: 1 }.serve(requests, &seen);
                        if let Err(e) = served {
                            say(&format!("hapfic: requests of operators are not answered any more: {e}"));
                        }
                    }
                    Err(e) => {
                        let _ = ready.send(Err(e));
                    }
                }
            })
            .context("cannot start the thread that answers operators")?;
        opened.recv().context("the thread that answers operators ended at once")??;
        Ok(Self { thread: Some(thread), end })
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            // It has said itself what went wrong, if anything did.
            let _ = thread.join();
        }
    }
}

/// The thread's state.
struct Desked {
    start: OperatorServerStart,
    /// The set that the next change is made on, as far as is known, and its version.
    base: Parameters,
    version: u64,
}

impl Desked {
    fn serve(&mut self, mut requests: Requests, end: &AtomicBool) -> Result<(), IpcError> {
        let mut swept = Instant::now();
        while !end.load(Ordering::Acquire) {
            wait(&[&requests], POLL_INTERVAL)?;
            while let Some(asked) = self.next(&mut requests) {
                let arrived = self.due_tick();
                let (reply, stop) = match asked.request.parts() {
                    Ok((OperatorKind::Set, text)) => (self.set(text), false),
                    Ok((OperatorKind::Status, _)) => (OperatorReply::new(ReplyCode::Done, &self.status_text()), false),
                    Ok((OperatorKind::Stop, _)) => (self.stop(), true),
                    Ok((OperatorKind::EmergencyStop, _)) => (self.emergency_stop(), false),
                    Ok((OperatorKind::Rearm, _)) => (self.rearm(), false),
                    Ok((OperatorKind::Inject, text)) => (self.inject(text), false),
                    Err(defect) => {
                        self.start.shared.requests_rejected.fetch_add(1, Ordering::Relaxed);
                        let text = format!("request rejected: {defect}; ask with the same version of hapfic that runs");
                        (OperatorReply::new(ReplyCode::Refused, &text), false)
                    }
                };
                // A caller that is gone has nobody to be told.
                let _ = asked.reply(&OperatorReply { arrived_tick: arrived, ..reply });
                if stop {
                    self.start.shared.asked_to_stop.store(true, Ordering::Release);
                }
            }
            if swept.elapsed() > SWEEP_EVERY && requests.crowded() {
                self.start.shared.cleanup_requested.store(true, Ordering::Release);
                swept = Instant::now();
            }
        }
        Ok(())
    }

    /// The next request. A connection that a killed caller has left half-made is no reason to stop answering the others.
    fn next(&self, requests: &mut Requests) -> Option<Asked> {
        requests.take().unwrap_or_else(|_| {
            self.start.shared.requests_rejected.fetch_add(1, Ordering::Relaxed);
            None
        })
    }

    fn due_tick(&self) -> i64 {
        self.start.shared.gated.load(Ordering::Acquire) + 1
    }

    fn stop(&self) -> OperatorReply {
        OperatorReply::new(ReplyCode::Done, &format!("run {} ends", self.start.run))
    }

    /// The gate latches at the next tick; what it takes until then is told.
    fn emergency_stop(&self) -> OperatorReply {
        let shared = &self.start.shared;
        shared.stop_latched(Detector::Operator);
        if self.await_gate(|severity| severity == Severity::Stopped) {
            let tick = shared.gated.load(Ordering::Acquire);
            return OperatorReply::new(
                ReplyCode::Done,
                &format!("latched stop at tick {tick}: the drive brakes until `hapfic rearm`"),
            );
        }
        OperatorReply::new(
            ReplyCode::Done,
            "latched stop asked for: no tick has been done since, so nothing moves the drive; it takes effect with the next one",
        )
    }

    fn rearm(&self) -> OperatorReply {
        let shared = &self.start.shared;
        if shared.severity.load(Ordering::Relaxed) != Severity::Stopped.code() {
            return OperatorReply::new(ReplyCode::Refused, "nothing to re-arm: the run is not in a latched stop");
        }
        shared.rearms.fetch_add(1, Ordering::AcqRel);
        if self.await_gate(|severity| severity < Severity::Stopped) {
            let text =
                "re-armed: the drive brakes until 20 ticks in a row were good, then the torque ramps in from where the foot is";
            return OperatorReply::new(ReplyCode::Done, text);
        }
        OperatorReply::new(ReplyCode::Done, "re-armed: takes effect with the next tick")
    }

    fn inject(&self, text: &str) -> OperatorReply {
        let rejected = |text: &str| OperatorReply::new(ReplyCode::Refused, text);
        let pairs: Vec<&str> = text.split('\0').filter(|pair| !pair.is_empty()).collect();
        let fault = match Fault::from_pairs(&pairs) {
            Ok(fault) => fault,
            Err(e) => return rejected(&e.to_string()),
        };
        if !self.start.shared.go.load(Ordering::Acquire) {
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
        OperatorReply::new(ReplyCode::Done, &format!("{}: at once, or as soon as it does ticks", watch::describe_fault(&fault)))
    }

    /// Waits until the gate's severity is as wished; not for ever.
    fn await_gate(&self, wished: impl Fn(Severity) -> bool) -> bool {
        let asked = Instant::now();
        while asked.elapsed() < GATE_PATIENCE {
            if Severity::from_code(self.start.shared.severity.load(Ordering::Acquire)).is_some_and(&wished) {
                return true;
            }
            std::thread::sleep(Duration::from_micros(500));
        }
        false
    }

    /// All pairs at one tick, or none.
    fn set(&mut self, text: &str) -> OperatorReply {
        let rejected = |text: &str| OperatorReply::new(ReplyCode::Refused, text);
        if !self.start.shared.go.load(Ordering::Acquire) {
            return rejected(
                "nothing changed: the run has not started yet, expected its first tick. Hint: try again in a moment",
            );
        }
        let arrived = self.due_tick();
        let pairs: Vec<&str> = text.split('\0').filter(|pair| !pair.is_empty()).collect();
        for _ in 0..TRIES {
            let asked = match OperatorChange::from_pairs(&pairs, &self.base) {
                Ok(asked) => asked,
                Err(e) => return rejected(&e.to_string()),
            };
            let made_on = asked.relative.then_some(self.version);
            let Some(answer) = self.start.change_client.ask(made_on, &asked.change, GATE_PATIENCE) else {
                return rejected(
                    "nothing changed: the gate has taken no change in time, expected it to look every tick. Hint: see `hapfic status`",
                );
            };
            let before = self.named(&answer);
            match answer.outcome {
                ChangeOutcome::Placed => {
                    let after = before.with(&asked.change);
                    (self.base, self.version) = (after, answer.version);
                    let text = describe(&answer, arrived, &before, &after);
                    return OperatorReply {
                        version: answer.version,
                        tick: answer.effective_tick,
                        taken_tick: answer.taken_tick,
                        ..OperatorReply::new(ReplyCode::Done, &text)
                    };
                }
                ChangeOutcome::Stale => (self.base, self.version) = (before, answer.version.saturating_sub(1)),
                ChangeOutcome::TooLate => {
                    return rejected(&format!(
                        "nothing changed: the run ends at tick {}, and the change could take effect at tick {} at the earliest",
                        self.start.ticks, answer.effective_tick
                    ));
                }
                ChangeOutcome::Full => {
                    return rejected("nothing changed: too many changes are waiting for their tick. Hint: try again in a moment");
                }
            }
        }
        rejected("nothing changed: the script changes parameters faster than single axes can be set. Hint: give the whole vector")
    }

    /// The set a change follows. Its target is the start's until one is given.
    fn named(&self, answer: &ChangeReply) -> Parameters {
        let target_position = answer.before.target_position.or(self.start.initial.target_position);
        Parameters { target_position, ..answer.before }
    }

    /// JSON that fits into a reply.
    fn status_text(&self) -> String {
        let status = self.status();
        let text = serde_json::to_string(&status).unwrap_or_default();
        if text.len() <= REPLY_TEXT {
            return text;
        }
        // Names may be as long as paths are; who asks has them from the registration.
        let short = Status { scenario: String::new(), log: PathBuf::new(), ..status };
        serde_json::to_string(&short).unwrap_or_default()
    }

    fn status(&self) -> Status {
        let shared = &self.start.shared;
        let snapshot = shared.snapshot.lock().map(|g| *g).unwrap_or_default();
        let tick = shared.gated.load(Ordering::Acquire);
        let latencies = if self.start.clock == Clock::Realtime { shared.latencies.sorted() } else { Vec::new() };
        let name = |process: Process| if process == GATE { "gate" } else { process.name() };
        Status {
            run: self.start.run.clone(),
            scenario: self.start.scenario.clone(),
            clock: self.start.clock.name().to_owned(),
            mode: Mode::from_code(snapshot.mode).map_or("?", Mode::name).to_owned(),
            severity: Severity::from_code(shared.severity.load(Ordering::Relaxed)).map_or("?", Severity::name).to_owned(),
            tick,
            end_tick: self.start.ticks,
            time_s: tick.max(0) as f64 * PERIOD_S,
            force_n: snapshot.foot_force,
            desired_force_n: snapshot.desired_force,
            tracking_m: snapshot.tracking,
            position_bound_m: snapshot.bound,
            parameters_version: snapshot.version,
            announced_version: shared.announced.load(Ordering::Relaxed),
            latency_us: LatencyQuantiles::of(&latencies),
            primary: Process::from_code(shared.primary.load(Ordering::Relaxed)).map_or("?", Process::name).to_owned(),
            processes: STARTED
                .iter()
                .filter(|process| self.start.standby || **process != Process::Standby)
                .chain([&GATE])
                .map(|process| {
                    let heartbeat = shared.heartbeat(*process);
                    ProcessStatus {
                        name: name(*process).to_owned(),
                        phase: heartbeat.phase().map_or("not heard of", Phase::name).to_owned(),
                        tick: heartbeat.tick(),
                        heard_ms_ago: heartbeat.age_ns().map(|ns| ns as f64 * 1e-6),
                        rejected: heartbeat.rejected(),
                    }
                })
                .collect(),
            late_ticks: snapshot.late,
            missed_ticks: snapshot.missed,
            brake_ticks: snapshot.braked,
            rejected_requests: shared.requests_rejected.load(Ordering::Relaxed),
            log: self.start.log.clone(),
            log_bytes: std::fs::metadata(&self.start.log).map_or(0, |m| m.len()),
        }
    }
}

fn describe(answer: &ChangeReply, arrived: i64, before: &Parameters, after: &Parameters) -> String {
    let mut text = format!(
        "parameters {} in force from tick {} (asked at tick {arrived}, taken at tick {})",
        answer.version, answer.effective_tick, answer.taken_tick
    );
    match differences(before, after) {
        Ok(list) if list.is_empty() => text.push_str("\n  all values are what they were"),
        Ok(list) => {
            for d in list {
                // Writing to a string cannot fail.
                let _ = write!(text, "\n  {}: {} -> {}", d.key, d.before, d.after);
            }
        }
        Err(e) => {
            let _ = write!(text, "\n  {e}");
        }
    }
    text
}
