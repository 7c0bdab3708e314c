//! The summary of a run: for people and, with the same content, for programs.

use crate::recorder::IncidentSummary;
use hapfic_log::MetricsSummary;
use hapfic_log::metrics::{
    ForceCommandSummary, ForceSummary, IntegrationSummary, MomentsSummary, PairSummary, Quantiles, TickSummary, TrackingSummary,
};
use hapfic_messages::Process;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Duration;

/// Everything there is to say about a run.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Name of the scenario, or its file.
    pub scenario: String,
    /// `realtime` or `lockstep`.
    pub clock: &'static str,
    /// Simulated time, s.
    pub duration_s: f64,
    /// Wall-clock time from first to last tick, s.
    pub wall_s: f64,
    /// Simulated seconds per wall second.
    pub speed: f64,
    /// From the start of the program to the first tick, s.
    pub launch_s: f64,
    /// Whether the run reached its end.
    pub completed: bool,
    /// x - x_d.
    pub tracking: TrackingSummary,
    /// F - F_d.
    pub force: ForceSummary,
    /// F_c.
    pub force_command: ForceCommandSummary,
    /// What happened in the scene.
    pub moments: MomentsSummary,
    /// What the plant's integrator had to do.
    pub integration: IntegrationSummary,
    /// By the wall clock.
    pub timing: Timing,
    /// The log.
    pub recorder: RecorderSummary,
    /// Ticks the figures are from.
    pub ticks: TickSummary,
    /// What the run got over.
    pub losses: Losses,
    /// Brakes and stops, and where they are described.
    pub incidents: Option<IncidentSummary>,
    /// What went wrong, in the order of time.
    pub faults: Vec<RunFault>,
    /// Where the log is.
    pub log: PathBuf,
}

/// By the wall clock.
#[derive(Clone, Debug, Serialize)]
pub struct Timing {
    /// State published to command published, us; none in lockstep.
    pub latency_us: Option<Quantiles>,
    /// Periods by which the plant's timer came late.
    pub late_ticks: u64,
    /// Ticks whose command no request of theirs stands behind.
    pub missed_ticks: u64,
    /// Ticks at which the drive braked after it had been active.
    pub brake_ticks: u64,
    /// How late the plant's timer was, us; none in lockstep.
    pub wake_lateness_us: Option<Quantiles>,
    /// Time the machine took away from all processors together, ms.
    pub steal_ms: u64,
    /// Ticks that the gate's spare has done.
    pub spare_gate_ticks: u64,
    /// Heap allocations between receiving and sending, in all processes.
    pub allocations: u64,
}

/// The log.
#[derive(Clone, Debug, Serialize)]
pub struct RecorderSummary {
    /// Messages written.
    pub messages: u64,
    /// Ticks missing in `/state` or `/command`.
    pub lost: u64,
    /// Size of the file, bytes.
    pub file_bytes: u64,
}

/// Processes that were lost, and what became of them.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Losses {
    /// Those that were lost at all.
    pub processes: Vec<Loss>,
    /// Faults that were made on purpose.
    pub injected: u64,
}

/// A process that was lost.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Loss {
    /// Its name.
    pub process: &'static str,
    /// How often.
    pub times: u32,
    /// Longest time from when it was found lost until its successor did ticks, ms.
    pub longest_ms: f64,
}

impl Losses {
    /// From each process's number of losses and longest time without it.
    pub fn new(all: impl Iterator<Item = (Process, u32, Duration)>, injected: u64) -> Self {
        let lost = all.filter(|(_, times, _)| *times > 0);
        let processes = lost.map(|(process, times, longest)| Loss {
            process: process.name(),
            times,
            longest_ms: longest.as_secs_f64() * 1e3,
        });
        Self { processes: processes.collect(), injected }
    }
}

/// Something that went wrong.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct RunFault {
    /// The process it is about.
    pub process: String,
    /// What happened.
    pub what: String,
    /// Who saw it: `exit`, `heartbeat`, `tick`, `signal`, `operator`, `recorder`, `start`.
    pub detector: &'static str,
    /// Last tick whose command had gone out.
    pub tick: i64,
}

impl Summary {
    /// Puts the metrics in their places.
    #[must_use]
    pub fn new(run: Run, metrics: &MetricsSummary, recorder: RecorderSummary) -> Self {
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
            timing: Timing {
                latency_us: metrics.timing.latency_us.filter(|_| realtime),
                late_ticks: metrics.timing.late_ticks,
                missed_ticks: metrics.timing.missed_ticks,
                brake_ticks: metrics.timing.brake_ticks,
                wake_lateness_us: metrics.timing.wake_lateness_us.filter(|_| realtime),
                steal_ms: run.steal_ms,
                spare_gate_ticks: run.spare_ticks,
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

    /// For the terminal.
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
            writeln!(out, "{} ({}): {end}, not a single tick was run; log: {}", self.scenario, self.clock, self.log.display())?;
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
        writeln!(out, "  timer lateness     {}  (the machine's own witness)", quantiles(&timing.wake_lateness_us))?;
        writeln!(
            out,
            "  ticks              {} late, {} missed, {} braked; {} ms stolen by the host; {} allocations in real-time code",
            timing.late_ticks, timing.missed_ticks, timing.brake_ticks, timing.steal_ms, timing.allocations
        )?;
        if timing.spare_gate_ticks > 0 {
            writeln!(
                out,
                "  gate               {} ticks by its spare, its own thread not being there in time",
                timing.spare_gate_ticks
            )?;
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

    /// What happened in the scene, where anything did.
    fn write_scene(&self, out: &mut String) -> std::fmt::Result {
        let outside = &self.tracking.outside;
        for (axis, name) in ["x", "y", "z"].iter().enumerate().filter(|&(axis, _)| outside.ticks[axis] > 0) {
            let seconds = |ticks: [u64; 3]| ticks[axis] as f64 * hapfic_config::PERIOD_S;
            let causes = [
                (outside.force_limited_ticks, "with F_c at F_max"),
                (outside.torque_limited_ticks, "with the torque cut"),
                (outside.force_held_ticks, "holding a force"),
                (outside.converging_ticks, "on the way back"),
                (outside.inactive_ticks, "without command"),
                (outside.unexplained_ticks, "unexplained"),
            ];
            let named = causes.into_iter().filter(|(ticks, _)| ticks[axis] > 0);
            let named: Vec<_> = named.map(|(ticks, what)| format!("{:.3} s {what}", seconds(ticks))).collect();
            writeln!(out, "  outside x_b        {name} {:.3} s: {}", seconds(outside.ticks), named.join(", "))?;
        }
        for object in self.moments.objects.iter() {
            write!(out, "  {:<18} turned {:.1} deg", object.name, object.max_turn_deg)?;
            write!(out, "{}", if object.tipped_at_rest { ", at rest on another face" } else { "" })?;
            write!(out, ", moved {:.0} mm", object.max_displacement_m * 1e3)?;
            // The foot itself is never free while it touches, but for touches too weak to count.
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
            writeln!(out, "  faults on purpose  {}", losses.injected)?;
        }
        for loss in &losses.processes {
            let times = if loss.times == 1 { "once".to_owned() } else { format!("{} times", loss.times) };
            writeln!(out, "  lost               {} {times}, back within {:.1} ms", loss.process, loss.longest_ms)?;
        }
        if let Some(incidents) = &self.incidents {
            writeln!(out, "  brakes and stops   {}, described in {}", incidents.count, incidents.file.display())?;
            if let Some(error) = &incidents.error {
                writeln!(out, "  brakes and stops   the description is not whole: {error}")?;
            }
        }
        for fault in &self.faults {
            writeln!(
                out,
                "  FAULT              {} {} (tick {}, seen by: {})",
                fault.process, fault.what, fault.tick, fault.detector
            )?;
        }
        Ok(())
    }
}

/// What only the supervisor knows of a run.
#[derive(Clone, Debug)]
pub struct Run {
    /// Name of the scenario.
    pub scenario: String,
    /// Name of the clock.
    pub clock: &'static str,
    /// Wall-clock time from first to last tick, s.
    pub wall_s: f64,
    /// From the start of the program to the first tick, s.
    pub launch_s: f64,
    /// Whether the run reached its end.
    pub completed: bool,
    /// Stolen time, ms.
    pub steal_ms: u64,
    /// Ticks that the gate's spare has done.
    pub spare_ticks: u64,
    /// What it got over.
    pub losses: Losses,
    /// Brakes and stops.
    pub incidents: Option<IncidentSummary>,
    /// What went wrong.
    pub faults: Vec<RunFault>,
    /// Where the log is.
    pub log: PathBuf,
}

/// Time stolen from all processors since boot, ms; zero where the system does not tell.
#[must_use]
pub fn steal_ms() -> u64 {
    let Ok(text) = std::fs::read_to_string("/proc/stat") else { return 0 };
    let ticks: Option<u64> = text.lines().next().and_then(|l| l.split_whitespace().nth(8)).and_then(|v| v.parse().ok());
    // USER_HZ is 100 on every Linux there is.
    ticks.unwrap_or(0) * 10
}
