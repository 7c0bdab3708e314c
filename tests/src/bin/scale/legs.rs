//! Realtime stacks beside each other.

use crate::usage::{Busy, Memory};
use hapfic_tests::{Stack, Started, is_running, remains_of};
use rustix::process::Signal;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// How long all stacks together may take to start.
const TO_START: Duration = Duration::from_secs(60);
/// How long one may take to end after it was asked to.
const TO_END: Duration = Duration::from_secs(10);
/// How often to look: seldom enough not to be in anybody's way.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// A log of so many bytes has ticks in it.
const WORKING_BYTES: u64 = 64 * 1024;
/// Simulated time of a run beyond that in which it is measured, s: the others may still be starting.
const SPARE_S: u64 = 5;
/// A run whose time slips may take so many times as long.
const SLOWEST: u32 = 8;

/// What became of one stack.
#[derive(Clone, Debug, Default)]
pub(crate) struct Leg {
    /// From its summary: ticks done, and of these missed, braked and slipped.
    pub(crate) ticks: u64,
    pub(crate) missed: u64,
    pub(crate) braked: u64,
    pub(crate) slipped: u64,
    /// From state to command, us: p50, p99, p99.9 and the largest.
    pub(crate) latency_us: Option<[f64; 4]>,
    /// Share of a core while all were running, by kind, %; `None` if it did not run so long.
    pub(crate) busy: Option<BTreeMap<&'static str, f64>>,
    /// Memory at the end of that.
    pub(crate) memory: Option<Memory>,
}

impl Leg {
    /// Takes its ticks from its summary. The error says what is missing there.
    fn ended(&mut self, summary: &Value) -> Result<(), String> {
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

/// So many stacks at once.
pub(crate) struct Count {
    pub(crate) legs: usize,
    /// Of all rounds.
    pub(crate) results: Vec<Leg>,
    /// What fell short.
    pub(crate) shortfalls: Vec<String>,
}

impl Count {
    pub(crate) fn new(legs: usize) -> Self {
        Self { legs, results: Vec::new(), shortfalls: Vec::new() }
    }

    /// A round of it.
    pub(crate) fn measure(&mut self, seconds: u64) {
        // One place: runs that know of each other take cores of their own as long as there are some.
        let stack = Stack::new();
        let (log, summary) = (|leg| stack.path(&format!("{leg}.mcap")), |leg| stack.path(&format!("{leg}.json")));
        let duration = (seconds + SPARE_S).to_string();
        let mut running: Vec<Started> = (0..self.legs)
            .map(|leg| {
                let [log, summary] = [log(leg), summary(leg)].map(|path: PathBuf| path.display().to_string());
                stack.start(&["run", "floor", "--duration", &duration, "--log", &log, "--summary-json", &summary])
            })
            .collect();
        let pids: Vec<u32> = running.iter().map(Started::pid).collect();
        let working = |leg: usize| {
            Busy::take(pids[leg]).is_some() && std::fs::metadata(log(leg)).is_ok_and(|log| log.len() >= WORKING_BYTES)
        };
        let begun = Instant::now();
        // One that has ended will not work any more, and says so in the end.
        while !(0..self.legs).all(|leg| working(leg) || !is_running(pids[leg])) && begun.elapsed() < TO_START {
            std::thread::sleep(POLL_INTERVAL);
        }
        let before: Vec<Option<Busy>> = pids.iter().map(|pid| Busy::take(*pid)).collect();
        std::thread::sleep(Duration::from_secs(seconds));
        let mut results: Vec<Leg> = pids
            .iter()
            .zip(before)
            .map(|(pid, before)| {
                let busy = Busy::take(*pid).zip(before).map(|(now, before)| now.since(&before));
                Leg { busy, ..Leg::default() }
            })
            .collect();
        // After all have been looked at: this takes the system some milliseconds.
        for (leg, pid) in results.iter_mut().zip(&pids) {
            leg.memory = Memory::take(*pid);
        }
        let limit = SLOWEST * Duration::from_secs(seconds + SPARE_S);
        for (number, (leg, running)) in results.iter_mut().zip(running.drain(..)).enumerate() {
            let fell = |what: String| format!("{} legs at once: leg {number}: {what}", self.legs);
            if let Err(what) = end(running, begun, limit).and_then(|()| read(&summary(number))).and_then(|s| leg.ended(&s)) {
                self.shortfalls.push(fell(what));
            }
            if leg.busy.is_none() {
                self.shortfalls.push(fell("was not running while it was measured".to_owned()));
            }
        }
        self.results.extend(results);
        if pids.iter().any(|pid| !remains_of(*pid).is_empty()) {
            // The next start in the same place removes what is left of a run that had to be ended by force.
            let sweep = stack.run(&["run", "floor", "--clock", "lockstep", "--duration", "0.05", "--log", "sweep.mcap"]);
            if sweep.code != Some(0) {
                self.shortfalls.push(format!("{} legs at once: what is left cannot be removed: {}", self.legs, sweep.err));
            }
        }
    }
}

/// Waits for a run's end; asks for it if it takes too long. The error says how it ended, if that is not as it should be.
fn end(running: Started, begun: Instant, limit: Duration) -> Result<(), String> {
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
        if !ended_by(Instant::now() + TO_END) {
            // Dropped, it is ended by force.
            return Err(format!("did not end within {limit:?}, nor when it was asked to"));
        }
    }
    let end = running.finish();
    // Why it failed is in its summary, if it has one.
    if matches!(end.code, Some(0 | 3)) { Ok(()) } else { Err(format!("ended with {:?}: {}", end.code, end.err.trim())) }
}

fn read(path: &PathBuf) -> Result<Value, String> {
    let text = std::fs::read_to_string(path).map_err(|error| format!("its summary cannot be read: {error}"))?;
    serde_json::from_str(&text).map_err(|error| format!("its summary cannot be read: {error}"))
}

#[cfg(test)]
mod tests {
    use super::Leg;
    use serde_json::json;

    #[test]
    fn a_summary_is_read() {
        let latency = json!({"p50": 50.0, "p99": 100.0, "p999": 200.0, "max": 300.0});
        let timing = json!({"missed_ticks": 1, "brake_ticks": 2, "late_ticks": 3, "latency_us": latency});
        let whole = json!({"completed": true, "ticks": {"last": 999}, "timing": timing, "faults": []});
        let mut leg = Leg::default();
        leg.ended(&whole).unwrap();
        assert_eq!((leg.ticks, leg.missed, leg.braked, leg.slipped), (1000, 1, 2, 3));
        assert_eq!(leg.latency_us, Some([50.0, 100.0, 200.0, 300.0]));
        let failed = json!({"completed": false, "ticks": {"last": 9}, "timing": timing, "faults": ["lost"]});
        assert!(Leg::default().ended(&failed).unwrap_err().contains("lost"));
        assert!(Leg::default().ended(&json!({})).unwrap_err().contains("missed_ticks"));
    }
}
