//! The summary of a run, as text and as JSON with the same content.

use crate::recorder::IncidentSummary;
use hapfic_gate_process::status::GateCounts;
use hapfic_log::MetricsSummary;
use hapfic_log::metrics::{
    ForceCommandSummary, ForceSummary, IntegrationSummary, MomentsSummary, PairSummary, Quantiles, TickSummary, TrackingSummary,
};
use hapfic_messages::{Detector, Process};
use serde::Serialize;
use std::fmt::Write;
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
    /// Ticks by the spare gate thread.
    pub spare_gate_ticks: u64,
    /// Torque steps beyond the limit of a healthy loop, as the gate has counted them.
    pub discontinuities: u64,
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
    /// Size of the file [bytes].
    pub file_bytes: u64,
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

    /// Formats the summary for a terminal.
    #[must_use]
    pub fn text(&self) -> String {
        let mut out = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut out);
        out
    }

    fn write(&self, out: &mut String) -> std::fmt::Result {
        let end = if self.completed { "completed" } else { "NOT COMPLETED" };
        if self.ticks.last.is_none() {
            writeln!(out, "{} ({}): {end}, no tick was done; log: {}", self.scenario, self.clock, self.log.display())?;
            return self.write_faults(out);
        }
        writeln!(
            out,
            "{} ({}): {end}, {:.3} s simulated in {:.2} s ({:.1} x), first tick {:.0} ms after the start",
            self.scenario,
            self.clock,
            self.duration_s,
            self.wall_s,
            self.speed,
            self.launch_s * 1e3
        )?;
        writeln!(out, "                        x          y          z")?;
        let row = |out: &mut String, name: &str, values: [String; 3]| {
            writeln!(out, "  {name:<14}{:>10} {:>10} {:>10}", values[0], values[1], values[2])
        };
        let t = &self.tracking;
        row(out, "|x - x_d| max", t.max_m.map(|v| format!("{:.3} mm", v * 1e3)))?;
        row(out, "          rms", t.rms_m.map(|v| format!("{:.3} mm", v * 1e3)))?;
        row(out, "bound x_b", t.bound_m.map(|v| format!("{:.1} mm", v * 1e3)))?;
        let c = &self.force_command;
        row(out, "|F_c| max", c.max_n.map(|v| format!("{v:.1} N")))?;
        row(out, "limit F_max", c.limit_n.map(|v| format!("{v:.0} N")))?;
        let f = &self.force;
        let some = |v: Option<f64>, unit: &str| v.map_or("-".to_owned(), |v| format!("{v:.3} {unit}"));
        row(out, "F_d (last)", f.desired_n.map(|v| v.map_or("-".to_owned(), |v| format!("{v:.0} N"))))?;
        row(out, "settled rms", f.settled_rms_n.map(|v| some(v, "N")))?;
        row(out, "  of F_d", f.settled_rms_percent.map(|v| some(v, "%")))?;
        row(out, "sliding rms", f.sliding_rms_percent.map(|v| some(v, "%")))?;
        self.write_scene(out)?;
        let timing = &self.timing;
        let quantiles = |q: &Option<Quantiles>| {
            q.map_or("none in lockstep".to_owned(), |q| {
                format!("p50 {:.0}  p99 {:.0}  p99.9 {:.0}  max {:.0} us", q.p50, q.p99, q.p999, q.max)
            })
        };
        writeln!(out, "  state -> command   {}", quantiles(&timing.latency_us))?;
        writeln!(out, "  timer lateness     {}  (reference timer)", quantiles(&timing.wake_lateness_us))?;
        writeln!(
            out,
            "  ticks              {} late, {} missed, {} braked; {} ms steal time; {} allocations in real-time code",
            timing.late_ticks, timing.missed_ticks, timing.brake_ticks, timing.steal_ms, timing.allocations
        )?;
        if timing.spare_gate_ticks > 0 {
            writeln!(out, "  gate               {} ticks by the spare gate thread", timing.spare_gate_ticks)?;
        }
        writeln!(
            out,
            "  log                {} messages, {:.1} MB, {} ticks lost: {}",
            self.recorder.messages,
            self.recorder.file_bytes as f64 / 1e6,
            self.recorder.lost,
            self.log.display()
        )?;
        self.write_faults(out)
    }

    /// Writes the events of the scene, if there are any.
    fn write_scene(&self, out: &mut String) -> std::fmt::Result {
        let outside = &self.tracking.outside;
        for (axis, name) in ["x", "y", "z"].iter().enumerate().filter(|&(axis, _)| outside.ticks[axis] > 0) {
            let seconds = |ticks: [u64; 3]| ticks[axis] as f64 * hapfic_config::PERIOD_S;
            let causes = [
                (outside.force_limited_ticks, "with F_c at F_max"),
                (outside.torque_limited_ticks, "with the torque cut"),
                (outside.force_held_ticks, "holding a force"),
                (outside.converging_ticks, "converging"),
                (outside.inactive_ticks, "without command"),
                (outside.unexplained_ticks, "unexplained"),
            ];
            let named = causes.into_iter().filter(|(ticks, _)| ticks[axis] > 0);
            let named: Vec<_> = named.map(|(ticks, what)| format!("{:.3} s {what}", seconds(ticks))).collect();
            writeln!(out, "  outside x_b        {name} {:.3} s: {}", seconds(outside.ticks), named.join(", "))?;
        }
        for object in self.moments.objects.iter() {
            write!(out, "  {:<18} rotated {:.1} deg", object.name, object.max_turn_deg)?;
            write!(out, "{}", if object.tipped_at_rest { ", at rest on another face" } else { "" })?;
            write!(out, ", moved {:.0} mm", object.max_displacement_m * 1e3)?;
            // A foot in contact counts as free only below the force threshold.
            let struck = |pair: &&PairSummary| pair.against == object.name && 2 * pair.foot_free_ticks > pair.ticks;
            for pair in self.moments.contacts.iter().filter(struck) {
                write!(out, "; {} on it {} ticks with the foot free", pair.body, pair.foot_free_ticks)?;
            }
            writeln!(out)?;
        }
        let i = &self.integration;
        if let (true, Some(newton)) = (i.contact_ticks > 0, i.newton_per_contact_substep) {
            writeln!(
                out,
                "  physics            {newton:.2} Newton iterations a sub-step, {} unconverged, {:.3} mJ created by contacts",
                i.unconverged,
                i.contact_energy_created_j * 1e3
            )?;
        }
        Ok(())
    }

    fn write_faults(&self, out: &mut String) -> std::fmt::Result {
        let losses = &self.losses;
        if losses.injected > 0 {
            writeln!(out, "  injected faults    {}", losses.injected)?;
        }
        if self.timing.discontinuities > 0 {
            writeln!(out, "  torque             {} discontinuities, in the events of the log", self.timing.discontinuities)?;
        }
        if self.timing.supervisor_delay_ms > SUPERVISOR_DELAY_MS {
            writeln!(out, "  supervisor         was itself delayed by up to {:.0} ms", self.timing.supervisor_delay_ms)?;
        }
        if let Some(problem) = &self.recorder.problem {
            writeln!(out, "  log                {problem}")?;
        }
        for loss in &losses.processes {
            let times = if loss.times == 1 { "once".to_owned() } else { format!("{} times", loss.times) };
            let outcome =
                if loss.recovered { format!("recovered within {:.1} ms", loss.longest_ms) } else { "NOT RECOVERED".to_owned() };
            writeln!(out, "  lost               {} {times}, {outcome}", loss.process)?;
        }
        if let Some(incidents) = &self.incidents {
            writeln!(out, "  brakes and stops   {}, described in {}", incidents.count, incidents.file.display())?;
            if let Some(error) = &incidents.error {
                writeln!(out, "  brakes and stops   the description is incomplete: {error}")?;
            }
        }
        for fault in &self.faults {
            if fault.is_request() {
                writeln!(out, "  ended              {} {} (tick {})", fault.process, fault.what, fault.tick)?;
                continue;
            }
            writeln!(
                out,
                "  FAULT              {} {} (tick {}, detected by: {})",
                fault.process,
                fault.what,
                fault.tick,
                fault.detector.name()
            )?;
        }
        Ok(())
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
    /// Largest delay of the supervisor's main thread.
    pub supervisor_delay: Duration,
    /// Lost and restarted processes.
    pub losses: Losses,
    /// Brakes and stops.
    pub incidents: Option<IncidentSummary>,
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
