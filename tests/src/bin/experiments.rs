//! Makes the tables of `docs/experiments.md`: the floor experiment over a range of wished forces, with each law.
//!
//! Every row is a lockstep run of the real stack, so the same command gives the same table on every machine.
#![allow(clippy::expect_used, clippy::print_stdout, clippy::print_stderr)]

use hapfic_tests::Stack;
use serde_json::Value;

const FORCES: [u32; 8] = [10, 20, 35, 50, 75, 100, 150, 200];
/// Place of the operator's entry of `floor` that wishes a force.
const FORCE_ENTRY: usize = 2;
/// Name of a law, and what selects it.
const LAWS: [(&str, &[&str]); 3] = [
    ("`tapered` + `contact_loss` (default)", &[]),
    ("`sign` + `contact_loss`", &["controller.search=sign"]),
    ("`fidelity = \"paper\"`", &["controller.fidelity=paper"]),
];

fn run(stack: &Stack, force: u32, law: &[&str]) -> Value {
    let force = format!("operator.{FORCE_ENTRY}.desired_force=[0, 0, {force}]");
    let mut arguments = vec!["run", "floor", "--clock", "lockstep", "--log", "run.mcap", "--summary-json", "run.json"];
    for set in law.iter().chain(&[force.as_str()]) {
        arguments.extend(["--set", set]);
    }
    stack.run(&arguments).expect(0);
    let text = std::fs::read_to_string(stack.path("run.json")).expect("a summary");
    serde_json::from_str(&text).expect("JSON")
}

fn largest(summary: &Value, group: &str, field: &str, per: &str) -> f64 {
    (0..3)
        .map(|axis| {
            let value = |name: &str| summary[group][name][axis].as_f64().expect("a number");
            value(field) / if per.is_empty() { 1.0 } else { value(per) }
        })
        .fold(0.0, f64::max)
}

fn percent(value: &Value) -> String {
    value.as_f64().map_or("-".to_owned(), |v| format!("{v:.3}"))
}

fn main() {
    let stack = Stack::new();
    println!(
        "| law | F_d, N | settled rms, % of F_d | sliding rms, % of F_d | max \\|x - x_d\\| / x_b | max \\|F_c\\| / F_max |"
    );
    println!("|---|---|---|---|---|---|");
    for (name, law) in LAWS {
        for force in FORCES {
            let summary = run(&stack, force, law);
            assert_eq!(summary["completed"], true);
            println!(
                "| {name} | {force} | {} | {} | {:.2} | {:.2} |",
                percent(&summary["force"]["settled_rms_percent"][2]),
                percent(&summary["force"]["sliding_rms_percent"][2]),
                largest(&summary, "tracking", "max_m", "bound_m"),
                largest(&summary, "force_command", "max_ratio", ""),
            );
            eprintln!("{name}: {force} N done");
        }
    }
}
