//! How a run is: what travels as JSON, and the table for a terminal.

use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::path::PathBuf;

/// How a run is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Name of the run.
    pub run: String,
    /// Name of the scenario.
    pub scenario: String,
    /// `realtime` or `lockstep`.
    pub clock: String,
    /// What the drive is asked to do.
    pub mode: String,
    /// How bad it is.
    pub severity: String,
    /// Last tick whose command went out; -1 before the first.
    pub tick: i64,
    /// Ticks of the run.
    pub end_tick: i64,
    /// Simulated time, s.
    pub time_s: f64,
    /// F, N.
    pub force_n: [f64; 3],
    /// F_d, N.
    pub desired_force_n: [f64; 3],
    /// x - x_d, m.
    pub tracking_m: [f64; 3],
    /// x_b, m.
    pub position_bound_m: [f64; 3],
    /// Version of the parameters in force.
    pub parameters_version: u64,
    /// Version of the parameters announced last.
    pub announced_version: u64,
    /// From state to command in the last second, us; none in lockstep.
    pub latency_us: Option<LatencyQuantiles>,
    /// Whose requests count if both controllers answer.
    pub primary: String,
    /// The processes, and the gate.
    pub processes: Vec<ProcessStatus>,
    /// Periods the plant's timer came late.
    pub late_ticks: u64,
    /// Ticks without a request of their own.
    pub missed_ticks: u64,
    /// Ticks at which the drive braked after it had been active.
    pub brake_ticks: u64,
    /// Requests of operators that could not be read.
    pub rejected_requests: u64,
    /// The log.
    pub log: PathBuf,
    /// Its size so far, bytes.
    pub log_bytes: u64,
}

/// How a process is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProcessStatus {
    /// Its name.
    pub name: String,
    /// The phase of its life.
    pub phase: String,
    /// The tick it told of last.
    pub tick: i64,
    /// How long ago it was heard of, ms.
    pub heard_ms_ago: Option<f64>,
    /// Messages it has rejected.
    pub rejected: u32,
}

/// Of latencies, us.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LatencyQuantiles {
    /// Median.
    pub p50: u32,
    /// One in a hundred is longer.
    pub p99: u32,
    /// The longest.
    pub max: u32,
}

impl LatencyQuantiles {
    /// Of values in ascending order.
    #[must_use]
    pub fn of(sorted: &[u32]) -> Option<Self> {
        let at = |percent: usize| sorted.get((sorted.len().saturating_sub(1) * percent).div_ceil(100)).copied();
        Some(Self { p50: at(50)?, p99: at(99)?, max: at(100)? })
    }
}

impl Status {
    /// For people.
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
            let heard = p.heard_ms_ago.map_or("never".to_owned(), |ms| format!("{ms:.0} ms ago"));
            let primary = if p.name == self.primary { ", primary" } else { "" };
            writeln!(out, "  {:<12}{:<14}tick {:<10}heard {heard:<12}{} rejected{primary}", p.name, p.phase, p.tick, p.rejected)?;
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
    fn quantiles_are_values_that_occurred() {
        assert_eq!(LatencyQuantiles::of(&[]), None);
        assert_eq!(LatencyQuantiles::of(&[7]), Some(LatencyQuantiles { p50: 7, p99: 7, max: 7 }));
        let all: Vec<u32> = (0..=1000).collect();
        assert_eq!(LatencyQuantiles::of(&all), Some(LatencyQuantiles { p50: 500, p99: 990, max: 1000 }));
    }
}
