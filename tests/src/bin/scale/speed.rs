//! Simulation speed of a scenario without a realtime clock.

use hapfic_tests::{FinishedProgram, StackSandbox, StartedProgram};
use serde_json::Value;

/// Mode of simulation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SimulationMode {
    /// Name in the table.
    pub(crate) name: &'static str,
    /// Simultaneous stacks of processes; zero for `hapfic simulate`.
    stacks: usize,
    /// Jobs of `hapfic simulate`.
    jobs: usize,
}

/// All modes, in the order of the table.
pub(crate) const MODES: [SimulationMode; 4] = [
    SimulationMode { name: "processes in lockstep, 1 stack", stacks: 1, jobs: 0 },
    SimulationMode { name: "processes in lockstep, 2 simultaneous stacks", stacks: 2, jobs: 0 },
    SimulationMode { name: "`hapfic simulate`, 1 job", stacks: 0, jobs: 1 },
    SimulationMode { name: "`hapfic simulate`, 2 jobs", stacks: 0, jobs: 2 },
];
/// Runs for each job of `hapfic simulate`.
const RUNS: usize = 2;

/// Measured speeds of a mode.
pub(crate) struct SpeedResult {
    pub(crate) mode: SimulationMode,
    /// Total speed of each round [simulated seconds per wall-clock second].
    pub(crate) totals: Vec<f64>,
    /// Shortfalls.
    pub(crate) shortfalls: Vec<String>,
}

impl SpeedResult {
    pub(crate) fn new(mode: SimulationMode) -> Self {
        Self { mode, totals: Vec::new(), shortfalls: Vec::new() }
    }

    /// Measures a round; `seconds` is the simulated time of a run.
    pub(crate) fn measure(&mut self, seconds: u64) {
        let stack = StackSandbox::new();
        let duration = seconds.to_string();
        let total = if self.mode.stacks > 0 {
            processes(&stack, self.mode.stacks, &duration)
        } else {
            study(&stack, self.mode.jobs, &duration)
        };
        match total {
            Ok(total) => self.totals.push(total),
            Err(cause) => self.shortfalls.push(format!("{}: {cause}", self.mode.name)),
        }
    }
}

/// Sum of the speeds of simultaneous stacks, each from its first to its last tick.
fn processes(stack: &StackSandbox, stacks: usize, duration: &str) -> Result<f64, String> {
    let file = |number: usize, ending: &str| stack.path(&format!("{number}.{ending}")).display().to_string();
    let started: Vec<StartedProgram> = (0..stacks)
        .map(|number| {
            let (log, summary) = (file(number, "mcap"), file(number, "json"));
            let clock = ["--clock", "lockstep", "--duration", duration];
            stack.start(&[&["run", "floor"][..], &clock, &["--log", &log, "--summary-json", &summary]].concat())
        })
        .collect();
    let mut total = 0.0;
    // Waits for all runs, before an error drops the others.
    let ended: Vec<FinishedProgram> = started.into_iter().map(StartedProgram::finish).collect();
    for (number, end) in ended.iter().enumerate() {
        expect_done(end)?;
        let text =
            std::fs::read_to_string(file(number, "json")).map_err(|error| format!("its summary cannot be read: {error}"))?;
        total += speed(&text)?;
    }
    Ok(total)
}

/// Speed of a study with a number of jobs.
fn study(stack: &StackSandbox, jobs: usize, duration: &str) -> Result<f64, String> {
    let runs = jobs * RUNS;
    // The floor scenario has no random part, so all runs are the same work.
    let sweep = format!("seed=1:{runs}:{runs}");
    let end = stack.run(&["simulate", "floor", "--duration", duration, "--sweep", &sweep, "--jobs", &jobs.to_string(), "--json"]);
    expect_done(&end)?;
    speed(&end.out)
}

fn expect_done(end: &FinishedProgram) -> Result<(), String> {
    if end.code == Some(0) { Ok(()) } else { Err(format!("ended with {:?}: {}{}", end.code, end.out, end.err)) }
}

/// Field `speed` of a JSON object.
fn speed(text: &str) -> Result<f64, String> {
    let object: Value = serde_json::from_str(text).map_err(|error| format!("its output is no JSON: {error}"))?;
    object["speed"]
        .as_f64()
        .filter(|speed| *speed > 0.0)
        .ok_or_else(|| format!("found speed {}, expected a number above 0", object["speed"]))
}

#[cfg(test)]
mod tests {
    use super::speed;

    #[test]
    fn speed_positive_number_required() {
        assert_eq!(speed("{\"speed\": 4.5}"), Ok(4.5));
        for bad in ["{}", "{\"speed\": 0}", "{\"speed\": null}", "no"] {
            assert!(speed(bad).is_err(), "{bad}");
        }
    }
}
