//! Simultaneous realtime stacks.

use crate::usage::{CpuTime, MemoryUse};
use hapfic_tests::{StackSandbox, StartedProgram, is_running, remains_of};
use rustix::process::Signal;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Time-out of the start of all stacks.
const START_TIMEOUT: Duration = Duration::from_secs(60);
/// Time-out of the end of a stack after a signal.
const END_TIMEOUT: Duration = Duration::from_secs(10);
/// Interval of the polls: long enough not to disturb the stacks.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Size from which a log has ticks [bytes].
const RUNNING_LOG_BYTES: u64 = 64 * 1024;
/// Simulated time of a run beyond its measurement [s]: other stacks may still be starting.
const MARGIN_S: u64 = 5;
/// Time limit of a run, as a multiple of its duration: time may slip.
const LIMIT_FACTOR: u32 = 8;

/// Result of one stack.
#[derive(Clone, Debug, Default)]
pub(crate) struct LegResult {
    /// Ticks of the run.
    pub(crate) ticks: u64,
    /// Missed ticks.
    pub(crate) missed: u64,
    /// Braked ticks.
    pub(crate) braked: u64,
    /// Slipped ticks.
    pub(crate) slipped: u64,
    /// Latency from state to command: p50, p99, p99.9 and maximum [us].
    pub(crate) latency_us: Option<[f64; 4]>,
    /// Share of a core during the measurement, by group [%]; `None` if the stack ended before.
    pub(crate) cpu: Option<BTreeMap<&'static str, f64>>,
    /// Memory at the end of the measurement.
    pub(crate) memory: Option<MemoryUse>,
}

impl LegResult {
    /// Reads a summary. The error has its first missing field, or the faults of the run.
    fn read_summary(&mut self, summary: &Value) -> Result<(), String> {
        let timing = &summary["timing"];
        let number = |name: &str| timing[name].as_u64().ok_or_else(|| format!("found no timing.{name} in its summary"));
        (self.missed, self.braked, self.slipped) = (number("missed_ticks")?, number("brake_ticks")?, number("late_ticks")?);
        self.ticks = summary["ticks"]["last"].as_u64().map_or(0, |last| last + 1);
        let latency = |name: &str| timing["latency_us"][name].as_f64();
        self.latency_us = ["p50", "p99", "p999", "max"]
            .map(latency)
            .into_iter()
            .collect::<Option<Vec<_>>>()
            .and_then(|all| all.try_into().ok());
        if summary["completed"] == true { Ok(()) } else { Err(format!("did not complete: {}", summary["faults"])) }
    }
}

/// Results of a number of simultaneous stacks.
pub(crate) struct LegCount {
    /// Number of stacks.
    pub(crate) legs: usize,
    /// Results of all rounds.
    pub(crate) results: Vec<LegResult>,
    /// Shortfalls.
    pub(crate) shortfalls: Vec<String>,
}

impl LegCount {
    pub(crate) fn new(legs: usize) -> Self {
        Self { legs, results: Vec::new(), shortfalls: Vec::new() }
    }

    /// Measures a round.
    pub(crate) fn measure(&mut self, seconds: u64) {
        // One sandbox: runs that see each other's registrations take separate cores as long as there are some.
        let stack = StackSandbox::new();
        let (log, summary) = (|leg| stack.path(&format!("{leg}.mcap")), |leg| stack.path(&format!("{leg}.json")));
        let duration = (seconds + MARGIN_S).to_string();
        let mut running: Vec<StartedProgram> = (0..self.legs)
            .map(|leg| {
                let [log, summary] = [log(leg), summary(leg)].map(|path: PathBuf| path.display().to_string());
                stack.start(&["run", "floor", "--duration", &duration, "--log", &log, "--summary-json", &summary])
            })
            .collect();
        let pids: Vec<u32> = running.iter().map(StartedProgram::pid).collect();
        let has_ticks = |leg: usize| {
            CpuTime::take(pids[leg]).is_some() && std::fs::metadata(log(leg)).is_ok_and(|log| log.len() >= RUNNING_LOG_BYTES)
        };
        let begun = Instant::now();
        // `end` reports a stack that has ended before.
        while !(0..self.legs).all(|leg| has_ticks(leg) || !is_running(pids[leg])) && begun.elapsed() < START_TIMEOUT {
            std::thread::sleep(POLL_INTERVAL);
        }
        let before: Vec<Option<CpuTime>> = pids.iter().map(|pid| CpuTime::take(*pid)).collect();
        std::thread::sleep(Duration::from_secs(seconds));
        let mut results: Vec<LegResult> = pids
            .iter()
            .zip(before)
            .map(|(pid, before)| {
                let cpu = CpuTime::take(*pid).zip(before).map(|(now, before)| now.since(&before));
                LegResult { cpu, ..LegResult::default() }
            })
            .collect();
        // After the processor times of all stacks, since this read takes some milliseconds.
        for (leg, pid) in results.iter_mut().zip(&pids) {
            leg.memory = MemoryUse::take(*pid);
        }
        let limit = LIMIT_FACTOR * Duration::from_secs(seconds + MARGIN_S);
        for (number, (leg, running)) in results.iter_mut().zip(running.drain(..)).enumerate() {
            let shortfall = |cause: String| format!("{} simultaneous legs: leg {number}: {cause}", self.legs);
            if let Err(cause) =
                end(running, begun, limit).and_then(|()| read(&summary(number))).and_then(|s| leg.read_summary(&s))
            {
                self.shortfalls.push(shortfall(cause));
            }
            if leg.cpu.is_none() {
                self.shortfalls.push(shortfall("did not run during the measurement".to_owned()));
            }
        }
        self.results.extend(results);
        if pids.iter().any(|pid| !remains_of(*pid).is_empty()) {
            // The next start in the same sandbox removes the remains of a killed run.
            let next = stack.run(&["run", "floor", "--clock", "lockstep", "--duration", "0.05", "--log", "clean_up.mcap"]);
            if next.code != Some(0) {
                self.shortfalls.push(format!("{} simultaneous legs: the remains cannot be removed: {}", self.legs, next.err));
            }
        }
    }
}

/// Waits for the end of a run, and ends it after a time limit. The error describes an unexpected end.
fn end(running: StartedProgram, begun: Instant, limit: Duration) -> Result<(), String> {
    let pid = running.pid();
    let ended_by = |until: Instant| {
        while is_running(pid) {
            if Instant::now() > until {
                return false;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
        true
    };
    if !ended_by(begun + limit) {
        running.signal(Signal::INT);
        if !ended_by(Instant::now() + END_TIMEOUT) {
            // Its drop kills the run.
            return Err(format!("did not end within {limit:?}, nor after SIGINT"));
        }
    }
    let end = running.finish();
    // The summary has the cause of a failure.
    if matches!(end.code, Some(0 | 3)) { Ok(()) } else { Err(format!("ended with {:?}: {}", end.code, end.err.trim())) }
}

fn read(path: &PathBuf) -> Result<Value, String> {
    let text = std::fs::read_to_string(path).map_err(|error| format!("its summary cannot be read: {error}"))?;
    serde_json::from_str(&text).map_err(|error| format!("its summary cannot be read: {error}"))
}

#[cfg(test)]
mod tests {
    use super::LegResult;
    use serde_json::json;

    #[test]
    fn read_summary_fields_and_failures_found() {
        let latency = json!({"p50": 50.0, "p99": 100.0, "p999": 200.0, "max": 300.0});
        let timing = json!({"missed_ticks": 1, "brake_ticks": 2, "late_ticks": 3, "latency_us": latency});
        let whole = json!({"completed": true, "ticks": {"last": 999}, "timing": timing, "faults": []});
        let mut leg = LegResult::default();
        leg.read_summary(&whole).unwrap();
        assert_eq!((leg.ticks, leg.missed, leg.braked, leg.slipped), (1000, 1, 2, 3));
        assert_eq!(leg.latency_us, Some([50.0, 100.0, 200.0, 300.0]));
        let failed = json!({"completed": false, "ticks": {"last": 9}, "timing": timing, "faults": ["lost"]});
        assert!(LegResult::default().read_summary(&failed).unwrap_err().contains("lost"));
        assert!(LegResult::default().read_summary(&json!({})).unwrap_err().contains("missed_ticks"));
    }
}
