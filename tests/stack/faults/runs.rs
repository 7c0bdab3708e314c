//! Runs with injected faults, and what their summaries say.

use hapfic_tests::{FinishedProgram, StackSandbox};
use serde_json::Value;

/// Settings for runs with many losses.
pub const UNLIMITED_RESTARTS: [&str; 4] =
    ["--set", "supervisor.restart_budget=100000", "--set", "supervisor.restart_backoff_ms=0"];

/// Runs a scenario with a log and a summary.
pub fn run(stack: &StackSandbox, scenario: &str, log: &str, more: &[&str]) -> FinishedProgram {
    let base = ["run", scenario, "--log", log, "--summary-json", "summary.json"];
    stack.run(&[&base[..], more].concat())
}

/// Summary of the last run.
pub fn summary(stack: &StackSandbox) -> Value {
    serde_json::from_slice(&std::fs::read(stack.path("summary.json")).unwrap()).unwrap()
}

/// Losses of a process in a summary.
pub fn losses(summary: &Value, process: &str) -> u64 {
    let all = summary["losses"]["processes"].as_array().unwrap();
    all.iter().find(|loss| loss["process"] == process).map_or(0, |loss| loss["times"].as_u64().unwrap())
}
