//! Runs of the tables, two at a time.

use crate::changes::{self, MeasuredChange};
use hapfic_tests::{StackSandbox, hapfic};
use serde_json::Value;
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Embedded scenarios of the tables.
pub(crate) const SCENARIOS: [&str; 5] = ["floor", "box", "ball", "ball-actuators", "tuning"];
/// Desired forces of the floor's table [N].
pub(crate) const FORCES: [u32; 8] = [10, 20, 35, 50, 75, 100, 150, 200];
/// Index of the operator's entry of `floor` that sets the desired force.
const FORCE_ENTRY: usize = 2;
/// Log of a run.
const LOG: &str = "run.mcap";
/// Simultaneous runs.
const SIMULTANEOUS_RUNS: usize = 2;

/// Name in a table, and its settings.
pub(crate) type NamedSettings = (&'static str, &'static [&'static str]);

/// The law with a fixed taper, a hardening profile and no damping.
const FIXED_TAPER: &[&str] = &[
    "controller.search=tapered",
    "controller.taper=0.2",
    "controller.saturation=continuous",
    "controller.damping_sqrt_kg=0",
    "controller.force_hold=false",
    "controller.continuous_reentry=false",
    "controller.posture_lead_s=0",
];
/// Compared laws.
pub(crate) const LAWS: [NamedSettings; 4] = [
    ("default", &[]),
    ("`tapered`, fixed taper", FIXED_TAPER),
    ("`sign` + `contact_loss`", &["controller.search=sign"]),
    ("`fidelity = \"paper\"`", &["controller.fidelity=paper"]),
];
/// Compared sub-steps of the integration.
pub(crate) const SUBSTEPS: [NamedSettings; 2] =
    [("20", &["plant.contact_substep_us=20"]), ("10", &["plant.contact_substep_us=10"])];
/// Settings without the improvements of the law.
const UNIMPROVED: &[&str] = &[
    "controller.offset_anti_windup=false",
    "controller.stall_release=false",
    "controller.force_hold=false",
    "controller.continuous_reentry=false",
];
/// Compared improvements of the law.
pub(crate) const IMPROVEMENTS: [NamedSettings; 6] = [
    ("all (default)", &[]),
    ("without `offset_anti_windup`", &["controller.offset_anti_windup=false"]),
    ("without `stall_release`", &["controller.stall_release=false"]),
    ("without `force_hold`", &["controller.force_hold=false"]),
    ("without `continuous_reentry`", &["controller.continuous_reentry=false"]),
    ("none of them", UNIMPROVED),
];
/// Scenarios of the comparison of improvements.
pub(crate) const IMPROVEMENT_SCENARIOS: [&str; 2] = ["tuning", "ball-actuators"];

/// Scenario with a table of its changes.
const TUNING_SCENARIO: &str = "tuning";
/// Settings of that scenario: with all improvements, and with none.
pub(crate) const TUNING_SETTINGS: [&[&str]; 2] = [&[], UNIMPROVED];

/// Setting of the desired force of `floor`.
pub(crate) fn force_setting(force: u32) -> String {
    format!("operator.{FORCE_ENTRY}.desired_force=[0, 0, {force}]")
}

/// Results of the runs, by scenario and settings.
#[derive(Default)]
pub(crate) struct ExperimentResults {
    summaries: BTreeMap<RunKey, Value>,
    changes: BTreeMap<RunKey, Vec<MeasuredChange>>,
}

type RunKey = (String, Vec<String>);

fn key(scenario: &str, settings: &[&str]) -> RunKey {
    (scenario.to_owned(), settings.iter().map(|&setting| setting.to_owned()).collect())
}

impl ExperimentResults {
    /// Summary of a run; null if the run wrote none.
    pub(crate) fn summary(&self, scenario: &str, settings: &[&str]) -> &Value {
        self.summaries.get(&key(scenario, settings)).expect("every run of a table is in the list of runs")
    }

    /// Operator's changes in `tuning` with one of [`TUNING_SETTINGS`]; none if the log cannot be read.
    pub(crate) fn changes(&self, settings: &[&str]) -> &[MeasuredChange] {
        self.changes.get(&key(TUNING_SCENARIO, settings)).map(Vec::as_slice).unwrap_or_default()
    }

    /// Iterates over all runs, each with its name.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (String, &Value)> {
        self.summaries.iter().map(|((scenario, settings), value)| (format!("{scenario} {}", settings.join(" ")), value))
    }
}

/// Whether every run completed.
pub(crate) fn complete(results: &ExperimentResults) -> bool {
    results.iter().all(|(_, summary)| summary["completed"] == true)
}

/// Lists the runs of all tables, each once.
fn list() -> Vec<RunKey> {
    let mut list = Vec::new();
    for (_, law) in LAWS {
        for force in FORCES {
            let force = force_setting(force);
            let settings: Vec<&str> = law.iter().copied().chain([force.as_str()]).collect();
            list.push(key("floor", &settings));
        }
    }
    for scenario in SCENARIOS {
        list.extend(LAWS.iter().chain(&SUBSTEPS).map(|(_, settings)| key(scenario, settings)));
    }
    for scenario in IMPROVEMENT_SCENARIOS {
        list.extend(IMPROVEMENTS.iter().map(|(_, settings)| key(scenario, settings)));
    }
    list.extend(TUNING_SETTINGS.map(|settings| key(TUNING_SCENARIO, settings)));
    list.sort();
    list.dedup();
    list
}

/// Runs all.
pub(crate) fn all() -> ExperimentResults {
    // Builds the binary before the threads start.
    hapfic();
    let list = list();
    let tuned = TUNING_SETTINGS.map(|settings| key(TUNING_SCENARIO, settings));
    let (next, results) = (AtomicUsize::new(0), Mutex::new(ExperimentResults::default()));
    std::thread::scope(|scope| {
        for _ in 0..SIMULTANEOUS_RUNS {
            scope.spawn(|| {
                let stack = StackSandbox::new();
                while let Some(key) = list.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let summary = run(&stack, key);
                    // The next run overwrites the log.
                    let changes = tuned.contains(key).then(|| changes_of(&stack, key));
                    let mut results = results.lock().unwrap();
                    results.summaries.insert(key.clone(), summary);
                    results.changes.extend(changes.map(|changes| (key.clone(), changes)));
                    eprintln!("{} of {}: {} {}", results.summaries.len(), list.len(), key.0, key.1.join(" "));
                }
            });
        }
    });
    results.into_inner().unwrap()
}

fn run(stack: &StackSandbox, (scenario, settings): &RunKey) -> Value {
    let mut arguments = vec!["run", scenario, "--clock", "lockstep", "--log", LOG, "--summary-json", "run.json"];
    for setting in settings {
        arguments.extend(["--set", setting]);
    }
    // Removes the files of an earlier run.
    for written in ["run.json", LOG] {
        let _ = std::fs::remove_file(stack.path(written));
    }
    let end = stack.run(&arguments);
    if end.code != Some(0) {
        eprintln!("{scenario} {settings:?} ended with {:?}:\n{}{}", end.code, end.out, end.err);
    }
    let text = std::fs::read_to_string(stack.path("run.json")).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or(Value::Null)
}

fn changes_of(stack: &StackSandbox, (scenario, settings): &RunKey) -> Vec<MeasuredChange> {
    changes::read(&stack.path(LOG)).unwrap_or_else(|error| {
        eprintln!("{scenario} {settings:?}: its changes are missing: {error}");
        Vec::new()
    })
}
