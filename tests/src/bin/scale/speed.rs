//! How fast a scenario is simulated.

use hapfic_tests::{Finished, Stack, Started};
use serde_json::Value;

/// A way to simulate.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Way {
    /// As the table calls it.
    pub(crate) name: &'static str,
    /// Stacks of processes at once; none: `hapfic simulate`.
    stacks: usize,
    /// Jobs of that.
    jobs: usize,
}

/// In the order of the table.
pub(crate) const WAYS: [Way; 4] = [
    Way { name: "processes in lockstep, 1 stack", stacks: 1, jobs: 0 },
    Way { name: "processes in lockstep, 2 stacks at once", stacks: 2, jobs: 0 },
    Way { name: "`hapfic simulate`, 1 job", stacks: 0, jobs: 1 },
    Way { name: "`hapfic simulate`, 2 jobs", stacks: 0, jobs: 2 },
];
/// Runs of `hapfic simulate` for each job.
const RUNS: usize = 2;

/// What was measured of a way.
pub(crate) struct Speed {
    pub(crate) way: Way,
    /// Simulated seconds per wall second, all together, of each round.
    pub(crate) totals: Vec<f64>,
    /// What fell short.
    pub(crate) shortfalls: Vec<String>,
}

impl Speed {
    pub(crate) fn new(way: Way) -> Self {
        Self { way, totals: Vec::new(), shortfalls: Vec::new() }
    }

    /// A round of it, of so many simulated seconds.
    pub(crate) fn measure(&mut self, seconds: u64) {
        let stack = Stack::new();
        let duration = seconds.to_string();
        let total = if self.way.stacks > 0 {
            processes(&stack, self.way.stacks, &duration)
        } else {
            study(&stack, self.way.jobs, &duration)
        };
        match total {
            Ok(total) => self.totals.push(total),
            Err(what) => self.shortfalls.push(format!("{}: {what}", self.way.name)),
        }
    }
}

/// The speeds of stacks that run at once, together: each from its first to its last tick.
fn processes(stack: &Stack, stacks: usize, duration: &str) -> Result<f64, String> {
    let file = |number: usize, ending: &str| stack.path(&format!("{number}.{ending}")).display().to_string();
    let started: Vec<Started> = (0..stacks)
        .map(|number| {
            let (log, summary) = (file(number, "mcap"), file(number, "json"));
            let clock = ["--clock", "lockstep", "--duration", duration];
            stack.start(&[&["run", "floor"][..], &clock, &["--log", &log, "--summary-json", &summary]].concat())
        })
        .collect();
    let mut total = 0.0;
    // All of them, before an error ends the rest.
    let ended: Vec<Finished> = started.into_iter().map(Started::finish).collect();
    for (number, end) in ended.iter().enumerate() {
        expect_done(end)?;
        let text = std::fs::read_to_string(file(number, "json")).map_err(|error| format!("no summary: {error}"))?;
        total += speed(&text)?;
    }
    Ok(total)
}

/// The speed of a study with so many jobs.
fn study(stack: &Stack, jobs: usize, duration: &str) -> Result<f64, String> {
    let runs = jobs * RUNS;
    // The floor has nothing random: they are all the same work.
    let sweep = format!("seed=1:{runs}:{runs}");
    let end = stack.run(&["simulate", "floor", "--duration", duration, "--sweep", &sweep, "--jobs", &jobs.to_string(), "--json"]);
    expect_done(&end)?;
    speed(&end.out)
}

fn expect_done(end: &Finished) -> Result<(), String> {
    if end.code == Some(0) { Ok(()) } else { Err(format!("ended with {:?}: {}{}", end.code, end.out, end.err)) }
}

/// `speed` of a JSON object.
fn speed(text: &str) -> Result<f64, String> {
    let object: Value = serde_json::from_str(text).map_err(|error| format!("what it wrote is no JSON: {error}"))?;
    object["speed"]
        .as_f64()
        .filter(|speed| *speed > 0.0)
        .ok_or_else(|| format!("found speed {}, expected a number above 0", object["speed"]))
}

#[cfg(test)]
mod tests {
    use super::speed;

    #[test]
    fn a_speed_is_read() {
        assert_eq!(speed("{\"speed\": 4.5}"), Ok(4.5));
        for wrong in ["{}", "{\"speed\": 0}", "{\"speed\": null}", "no"] {
            assert!(speed(wrong).is_err(), "{wrong}");
        }
    }
}
