//! Status of a run: its JSON form, and the table for a terminal.

use hapfic_config::PERIOD_S;
use hapfic_simulation::conditions::TaskReport;
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::path::PathBuf;

/// Status of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Name of the run.
    pub run: String,
    /// Name of the scenario.
    pub scenario: String,
    /// `realtime` or `lockstep`.
    pub clock: String,
    /// Mode of the last command.
    pub mode: String,
    /// Severity, `nominal` to `stopped`.
    pub severity: String,
    /// What requested the latched stop, if the run is in one: `operator` or `budget`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stopped_by: Option<String>,
    /// Last tick whose command was published; -1 before the first.
    pub tick: i64,
    /// Ticks of the run.
    pub end_tick: i64,
    /// Simulated time [s].
    pub time_s: f64,
    /// Measured reaction F [N].
    pub force_n: [f64; 3],
    /// Desired force F_d [N].
    pub desired_force_n: [f64; 3],
    /// Position error x - x_d [m].
    pub tracking_m: [f64; 3],
    /// Position bound x_b [m].
    pub position_bound_m: [f64; 3],
    /// Version of the parameters in force.
    pub parameters_version: u64,
    /// Version of the parameters announced last.
    pub announced_version: u64,
    /// Latency from state to command in the last second [us]; none in lockstep.
    pub latency_us: Option<LatencyQuantiles>,
    /// Primary controller: the gate uses its requests if both controllers send them.
    pub primary: String,
    /// Status of the processes and of the gate.
    pub processes: Vec<ProcessStatus>,
    /// Periods by which the plant's timer was late.
    pub late_ticks: u64,
    /// Ticks whose command is not from a request of the same tick.
    pub missed_ticks: u64,
    /// Ticks in which the drive braked after the first active one.
    pub brake_ticks: u64,
    /// Unreadable requests of operators.
    pub rejected_requests: u64,
    /// Conditions of the task that hold now.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tasks: Vec<TaskReport>,
    /// Path of the log.
    pub log: PathBuf,
    /// Size of the log so far [bytes].
    pub log_bytes: u64,
}

/// Status of a process.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProcessStatus {
    /// Name of the process.
    pub name: String,
    /// Phase of the process.
    pub phase: String,
    /// Tick of its last heartbeat.
    pub tick: i64,
    /// Heartbeat age [ms].
    pub heartbeat_age_ms: Option<f64>,
    /// Number of rejected messages.
    pub rejected: u32,
}

/// Quantiles of latencies [us].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LatencyQuantiles {
    /// Median.
    pub p50: u32,
    /// Latency that 99 % do not exceed.
    pub p99: u32,
    /// Maximum.
    pub max: u32,
}

impl LatencyQuantiles {
    /// Computes the quantiles of values in ascending order; `None` if there are none.
    #[must_use]
    pub fn of(sorted: &[u32]) -> Option<Self> {
        let at = |percent: usize| sorted.get((sorted.len().saturating_sub(1) * percent).div_ceil(100)).copied();
        Some(Self { p50: at(50)?, p99: at(99)?, max: at(100)? })
    }
}

impl Status {
    /// Formats the status for a terminal.
    #[must_use]
    pub fn table(&self) -> String {
        let mut out = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut out);
        out
    }

    fn write(&self, out: &mut String) -> std::fmt::Result {
        writeln!(
            out,
            "{} ({})  run {}  {}, {}  tick {} of {}  {:.3} s",
            self.scenario, self.clock, self.run, self.mode, self.severity, self.tick, self.end_tick, self.time_s
        )?;
        match self.stopped_by.as_deref() {
            Some("budget") => writeln!(out, "  latched stop: a process was lost once more than its restart budget allows")?,
            Some(_) => writeln!(out, "  latched stop: requested by an operator")?,
            None => {}
        }
        for task in &self.tasks {
            let since = task.since_tick.unwrap_or(self.tick) as f64 * PERIOD_S;
            let place = if task.place.is_empty() { String::new() } else { format!(" on {}", task.place) };
            writeln!(out, "  task: {}{place} since {since:.3} s: {}", task.condition, task.found)?;
        }
        writeln!(out, "                        x          y          z")?;
        let mut row = |name: &str, values: [f64; 3], scale: f64, unit: &str| {
            let [x, y, z] = values.map(|v| format!("{:.2} {unit}", v * scale));
            writeln!(out, "  {name:<14}{x:>11}{y:>11}{z:>11}")
        };
        row("F", self.force_n, 1.0, "N")?;
        row("F_d", self.desired_force_n, 1.0, "N")?;
        row("|x - x_d|", self.tracking_m.map(f64::abs), 1e3, "mm")?;
        row("bound x_b", self.position_bound_m, 1e3, "mm")?;
        writeln!(out, "  parameters {} in force, {} announced", self.parameters_version, self.announced_version)?;
        match self.latency_us {
            Some(q) => writeln!(out, "  state -> command, last second: p50 {}  p99 {}  max {} us", q.p50, q.p99, q.max)?,
            None => writeln!(out, "  state -> command: none in lockstep")?,
        }
        for p in &self.processes {
            let age = p.heartbeat_age_ms.map_or("never".to_owned(), |ms| format!("{ms:.0} ms ago"));
            let primary = if p.name == self.primary { ", primary" } else { "" };
            writeln!(
                out,
                "  {:<12}{:<14}tick {:<10}heartbeat {age:<12}{} rejected{primary}",
                p.name, p.phase, p.tick, p.rejected
            )?;
        }
        writeln!(
            out,
            "  ticks: {} late, {} missed, {} braked; {} requests rejected",
            self.late_ticks, self.missed_ticks, self.brake_ticks, self.rejected_requests
        )?;
        writeln!(out, "  log: {:.1} MB, {}", self.log_bytes as f64 / 1e6, self.log.display())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn latency_quantiles_sorted_values_return_occurring_ones() {
        assert_eq!(LatencyQuantiles::of(&[]), None);
        assert_eq!(LatencyQuantiles::of(&[7]), Some(LatencyQuantiles { p50: 7, p99: 7, max: 7 }));
        let all: Vec<u32> = (0..=1000).collect();
        assert_eq!(LatencyQuantiles::of(&all), Some(LatencyQuantiles { p50: 500, p99: 990, max: 1000 }));
    }
}
