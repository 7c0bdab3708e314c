//! Runs that last until a test ends them.

use hapfic_tests::{StackSandbox, StartedProgram};
use serde_json::Value;
use std::time::{Duration, Instant};

/// Time-out of every wait of a test.
pub const TIMEOUT: Duration = Duration::from_secs(60);

/// Returns the embedded scenario `floor` without its script, so only the test changes parameters.
pub fn unscripted(stack: &StackSandbox) -> String {
    let floor = stack.run(&["scenarios", "floor"]).expect(0).out.clone();
    let (body, _) = floor.split_once("[[operator]]").expect("a script");
    body.to_owned()
}

/// Starts a run of an hour, with a scenario file and a log of its own.
pub fn start(stack: &StackSandbox, name: &str, clock: &str) -> StartedProgram {
    let scenario = format!("{name}.toml");
    std::fs::write(stack.path(&scenario), unscripted(stack)).unwrap();
    let log = format!("{name}.mcap");
    stack.start(&["run", &scenario, "--clock", clock, "--duration", "3600", "--log", &log])
}

/// Waits until the only run has reached a tick, and returns its status.
pub fn status_at(stack: &StackSandbox, tick: i64) -> Value {
    let begun = Instant::now();
    loop {
        let end = stack.run(&["status", "--json"]);
        assert!(begun.elapsed() < TIMEOUT, "the run does not reach tick {tick}:\n{}\n{}", end.out, end.err);
        if end.code != Some(0) {
            continue;
        }
        let status: Value = serde_json::from_str(&end.out).unwrap();
        if status["tick"].as_i64().unwrap() >= tick {
            return status;
        }
    }
}
