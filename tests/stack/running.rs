//! Runs that go on until a test ends them.

use hapfic_tests::{Stack, Started};
use serde_json::Value;
use std::time::{Duration, Instant};

/// How long anything may take before a test gives up.
pub const TIMEOUT: Duration = Duration::from_secs(60);

/// The embedded scenario without its script, so that nothing but the test changes parameters.
pub fn unscripted(stack: &Stack) -> String {
    let floor = stack.run(&["scenarios", "floor"]).expect(0).out.clone();
    let (body, _) = floor.split_once("[[operator]]").expect("a script");
    body.to_owned()
}

/// Starts a run far longer than any test, in a file of its own.
pub fn start(stack: &Stack, name: &str, clock: &str) -> Started {
    let scenario = format!("{name}.toml");
    std::fs::write(stack.path(&scenario), unscripted(stack)).unwrap();
    let log = format!("{name}.mcap");
    stack.start(&["run", &scenario, "--clock", clock, "--duration", "3600", "--log", &log])
}

/// The status of the only run, as soon as it has got to a tick.
pub fn status_at(stack: &Stack, tick: i64) -> Value {
    let begun = Instant::now();
    loop {
        let end = stack.run(&["status", "--json"]);
        assert!(begun.elapsed() < TIMEOUT, "tick {tick} does not come:\n{}\n{}", end.out, end.err);
        if end.code != Some(0) {
            continue;
        }
        let status: Value = serde_json::from_str(&end.out).unwrap();
        if status["tick"].as_i64().unwrap() >= tick {
            return status;
        }
    }
}
