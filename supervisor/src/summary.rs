//! The summary of a run, as text and as JSON with the same content.

mod text;

use crate::recorder::IncidentSummary;
use hapfic_ipc::run_status::GateCounts;
use hapfic_log::MetricsSummary;
use hapfic_log::metrics::{
    ForceCommandSummary, ForceSummary, IntegrationSummary, MomentsSummary, Quantiles, TickSummary, TrackingSummary,
};
use hapfic_messages::{Detector, Process};
use hapfic_simulation::conditions::TaskReport;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Duration;

/// Delay of the supervisor from which the summary reports it [ms].
const SUPERVISOR_DELAY_MS: f64 = 200.0;

/// Summary of a run.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Name of the scenario, or its file.
    pub scenario: String,
    /// `realtime` or `lockstep`.
    pub clock: &'static str,
    /// Simulated time [s].
    pub duration_s: f64,
    /// Wall-clock time from the first to the last tick [s].
    pub wall_s: f64,
    /// Ratio of simulated time to wall-clock time.
    pub speed: f64,
    /// Time from the start of the program to the first tick [s].
    pub launch_s: f64,
    /// Whether the run reached its end.
    pub completed: bool,
    /// Position error x - x_d.
    pub tracking: TrackingSummary,
    /// Force error F - F_d.
    pub force: ForceSummary,
    /// Force of the attractor F_c.
    pub force_command: ForceCommandSummary,
    /// Events of the scene.
    pub moments: MomentsSummary,
    /// Conditions of the task that held.
    pub tasks: Vec<TaskReport>,
    /// Effort of the plant's integrator.
    pub integration: IntegrationSummary,
    /// Wall-clock times.
    pub timing: RunTiming,
    /// Size of the log, and lost ticks.
    pub recorder: RecorderSummary,
    /// Ticks that the metrics cover.
    pub ticks: TickSummary,
    /// Lost and restarted processes.
    pub losses: Losses,
    /// Brakes and stops, and the path of their post-mortem.
    pub incidents: Option<IncidentSummary>,
    /// Faults that ended the run, in the order of time.
    pub faults: Vec<RunFault>,
    /// Path of the log.
    pub log: PathBuf,
}

/// Wall-clock times of a run.
#[derive(Clone, Debug, Serialize)]
pub struct RunTiming {
    /// Latency from a published state to the published command [us]; none in lockstep.
    pub latency_us: Option<Quantiles>,
    /// Periods by which the plant's timer was late.
    pub late_ticks: u64,
    /// Ticks whose command is not from a request of the same tick.
    pub missed_ticks: u64,
    /// Ticks in which the drive braked after the first active one.
    pub brake_ticks: u64,
    /// Lateness of the plant's timer [us]; none in lockstep.
    pub wake_lateness_us: Option<Quantiles>,
    /// Steal time, the sum of all processors [ms].
    pub steal_ms: u64,
    /// Ticks by the gate that was not the active one.
    pub spare_gate_ticks: u64,
    /// Ticks in which the torque of a joint stepped by more than `discontinuity_n_m`, as the gate has counted them.
    pub discontinuities: u64,
    /// Step of a joint's torque from which it counts as a discontinuity [N m; N for a prismatic joint].
    pub discontinuity_n_m: f64,
    /// Largest delay of the supervisor's own main thread [ms].
    pub supervisor_delay_ms: f64,
    /// Heap allocations between receiving and sending, in all processes.
    pub allocations: u64,
}

/// Size of the log, and lost ticks.
#[derive(Clone, Debug, Serialize)]
pub struct RecorderSummary {
    /// Messages written.
    pub messages: u64,
    /// Ticks missing in `/state` or `/command`.
    pub lost: u64,
    /// Size of all parts that were written [bytes].
    pub file_bytes: u64,
    /// Number of parts that were written.
    pub parts: u32,
    /// Number of parts that were removed again (`recorder.keep_mb`).
    pub removed_parts: u32,
    /// Description of a log that was deleted or replaced during the run.
    pub problem: Option<String>,
}

/// Lost processes of a run, and injected faults.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Losses {
    /// Processes that were lost at least once.
    pub processes: Vec<ProcessLoss>,
    /// Number of injected faults.
    pub injected: u64,
}

/// Losses of one process.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProcessLoss {
    /// Name of the process.
    pub process: &'static str,
    /// Number of losses.
    pub times: u32,
    /// Longest time from the detected loss to the successor's first tick [ms].
    pub longest_ms: f64,
    /// Whether the process, or a successor, did ticks at the end.
    pub recovered: bool,
}

impl Losses {
    /// Creates the summary from the number of losses, the longest outage and the final presence of each process.
    pub fn new(all: impl Iterator<Item = (Process, u32, Duration, bool)>, injected: u64) -> Self {
        let lost = all.filter(|(_, times, ..)| *times > 0);
        let processes = lost.map(|(process, times, longest, recovered)| ProcessLoss {
            recovered,
            process: process.name(),
            times,
            longest_ms: longest.as_secs_f64() * 1e3,
        });
        Self { processes: processes.collect(), injected }
    }
}

/// A fault that the run did not survive.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct RunFault {
    /// Name of the process.
    pub process: String,
    /// Description without the name of the process.
    pub what: String,
    /// Detector that found it; its name in JSON.
    #[serde(serialize_with = "detector_name")]
    pub detector: Detector,
    /// Last tick whose command was published.
    pub tick: i64,
}

fn detector_name<S: serde::Serializer>(detector: &Detector, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(detector.name())
}

impl RunFault {
    /// Faults as text, one JSON list each.
    pub(crate) fn to_text(faults: &[Self]) -> String {
        let rows: Vec<_> = faults.iter().map(|f| (&f.process, &f.what, f.detector.code(), f.tick)).collect();
        serde_json::to_string(&rows).unwrap_or_default()
    }

    /// Faults of a text; none if it is no such text.
    pub(crate) fn of_text(text: &[u8]) -> Vec<Self> {
        let rows: Vec<(String, String, u32, i64)> = serde_json::from_slice(text).unwrap_or_default();
        let fault = |(process, what, code, tick)| Some(Self { process, what, detector: Detector::from_code(code)?, tick });
        rows.into_iter().filter_map(fault).collect()
    }

    /// Whether an operator or a signal has ended the run as requested.
    fn is_request(&self) -> bool {
        matches!(self.detector, Detector::Operator | Detector::Signal)
    }
}

impl Summary {
    /// Combines the data of the supervisor, the metrics and the data of the recorder.
    #[must_use]
    pub fn new(run: RunSummary, metrics: &MetricsSummary, recorder: RecorderSummary) -> Self {
        let realtime = run.clock == "realtime";
        let duration_s = metrics.ticks.last.map_or(0.0, |last| (last + 1) as f64 * hapfic_config::PERIOD_S);
        Self {
            scenario: run.scenario,
            clock: run.clock,
            duration_s,
            wall_s: run.wall_s,
            speed: if run.wall_s > 0.0 { duration_s / run.wall_s } else { 0.0 },
            launch_s: run.launch_s,
            completed: run.completed,
            tracking: metrics.tracking,
            force: metrics.force,
            force_command: metrics.force_command,
            moments: metrics.moments,
            tasks: run.tasks,
            integration: metrics.integration,
            timing: RunTiming {
                latency_us: metrics.timing.latency_us.filter(|_| realtime),
                late_ticks: metrics.timing.late_ticks,
                missed_ticks: run.gate.missed,
                brake_ticks: run.gate.braked,
                wake_lateness_us: metrics.timing.wake_lateness_us.filter(|_| realtime),
                steal_ms: run.steal_ms,
                spare_gate_ticks: run.gate.spare,
                discontinuities: run.gate.discontinuities,
                discontinuity_n_m: run.discontinuity_n_m,
                supervisor_delay_ms: run.supervisor_delay.as_secs_f64() * 1e3,
                allocations: metrics.timing.allocations,
            },
            recorder,
            ticks: metrics.ticks,
            losses: run.losses,
            incidents: run.incidents,
            faults: run.faults,
            log: run.log,
        }
    }
}

/// Part of a run's summary that only the supervisor has.
#[derive(Clone, Debug)]
pub struct RunSummary {
    /// Name of the scenario.
    pub scenario: String,
    /// Name of the clock.
    pub clock: &'static str,
    /// Wall-clock time from the first to the last tick [s].
    pub wall_s: f64,
    /// Time from the start of the program to the first tick [s].
    pub launch_s: f64,
    /// Whether the run reached its end.
    pub completed: bool,
    /// Steal time [ms].
    pub steal_ms: u64,
    /// Counts of the gate.
    pub gate: GateCounts,
    /// Step of a joint's torque above which the gate counts it [N m; N for a prismatic joint].
    pub discontinuity_n_m: f64,
    /// Largest delay of the supervisor's main thread.
    pub supervisor_delay: Duration,
    /// Lost and restarted processes.
    pub losses: Losses,
    /// Brakes and stops.
    pub incidents: Option<IncidentSummary>,
    /// Conditions of the task that held.
    pub tasks: Vec<TaskReport>,
    /// Faults that ended the run.
    pub faults: Vec<RunFault>,
    /// Path of the log.
    pub log: PathBuf,
}

/// Returns the steal time of all processors since boot [ms]; zero if the system does not report it.
#[must_use]
pub fn steal_ms() -> u64 {
    hapfic_ipc::clock::steal_ms(&std::fs::read_to_string("/proc/stat").unwrap_or_default(), "cpu").unwrap_or(0)
}
