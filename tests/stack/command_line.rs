//! Output of `scenarios`, `check` and `schema`, and the summary of a run.

use hapfic_tests::StackSandbox;
use serde_json::Value;

#[test]
fn scenarios_printed_text_passes_check() {
    let stack = StackSandbox::new();
    assert!(stack.run(&["scenarios"]).expect(0).out.contains("floor"));
    assert!(stack.run(&["check", "floor"]).expect(0).out.contains("valid"));
    let schema: Value = serde_json::from_str(&stack.run(&["schema"]).expect(0).out).unwrap();
    assert!(schema["properties"]["controller"].is_object() || schema["$defs"].is_object());
    // The printed scenario is valid from a path too.
    let text = stack.run(&["scenarios", "floor"]).expect(0).out.clone();
    std::fs::write(stack.path("mine.toml"), text).unwrap();
    assert!(stack.run(&["check", "mine.toml"]).expect(0).out.contains("valid"));
}

#[test]
fn layouts_for_c_compile_and_match() {
    let stack = StackSandbox::new();
    let header = stack.run(&["schema", "--messages", "c"]).expect(0).out.clone();
    std::fs::write(stack.path("messages.h"), header).unwrap();
    // The static assertions of the header compare the compiler's layout with Rust's.
    std::fs::write(stack.path("test.c"), "#include \"messages.h\"\nint main(void) { return 0; }\n").unwrap();
    let mut compile = std::process::Command::new("cc");
    compile.args(["-std=c11", "-Wall", "-Werror", "-o", "test", "test.c"]).current_dir(stack.path(""));
    assert!(compile.status().unwrap().success());
    let json: Value = serde_json::from_str(&stack.run(&["schema", "--messages", "json"]).expect(0).out).unwrap();
    let state = json["structs"].as_array().unwrap().iter().find(|layout| layout["wire_name"] == "hapfic.State").unwrap();
    assert_eq!(state["size"], std::mem::size_of::<hapfic_messages::State>());
}

#[test]
fn cross_check_prints_both_engines() {
    let stack = StackSandbox::new();
    let table = stack.run(&["cross-check", "floor", "--duration", "4"]).expect(0).out.clone();
    let row = table.lines().find(|line| line.contains("settled force on z")).unwrap();
    let values: Vec<f64> = row.split('|').filter_map(|cell| cell.trim().parse().ok()).collect();
    assert!(values.len() == 2 && values.iter().all(|percent| *percent < 0.2), "{table}");
    let refused = stack.run(&["cross-check", "floor", "--set", "plant.rapier_substep_us=5"]);
    refused.expect(2);
    assert!(refused.err.contains("plant.rapier_substep_us"), "{}", refused.err);
}

#[test]
fn summary_json_fields_present() {
    let stack = StackSandbox::new();
    let end = stack.run(&["run", "floor", "--clock", "lockstep", "--log", "run.mcap", "--summary-json", "summary.json"]);
    end.expect(0);
    assert!(end.err.is_empty(), "found messages of a run without a terminal, expected none: {}", end.err);
    let summary: Value = serde_json::from_str(&std::fs::read_to_string(stack.path("summary.json")).unwrap()).unwrap();
    assert_eq!(summary["scenario"], "floor");
    assert_eq!(summary["clock"], "lockstep");
    assert_eq!(summary["duration_s"], 10.0);
    assert_eq!(summary["completed"], true);
    assert_eq!(summary["faults"], serde_json::json!([]));
    assert_eq!(summary["log"], "run.mcap");
    assert_eq!(summary["recorder"]["lost"], 0);
    assert!(summary["recorder"]["messages"].as_u64().unwrap() > 80_000);
    for (group, field) in [
        ("tracking", "max_m"),
        ("tracking", "rms_m"),
        ("tracking", "bound_m"),
        ("force", "desired_n"),
        ("force", "settled_rms_n"),
        ("force", "settled_rms_percent"),
        ("force", "sliding_rms_percent"),
        ("force_command", "max_n"),
        ("force_command", "limit_n"),
    ] {
        assert_eq!(summary[group][field].as_array().map(Vec::len), Some(3), "{group}.{field}");
    }
    for field in ["late_ticks", "missed_ticks", "steal_ms"] {
        assert!(summary["timing"][field].is_u64(), "timing.{field}");
    }
    // The paper's experiment: 50 N at rest and while sliding, within the bounds.
    assert_eq!(summary["force"]["desired_n"][2], 50.0);
    assert!(summary["force"]["settled_rms_percent"][2].as_f64().unwrap() <= 0.2);
    assert!(summary["force"]["sliding_rms_percent"][2].as_f64().unwrap() <= 3.5);
    assert_eq!(summary["force_command"]["above_limit_ticks"], 0);
    assert_eq!(summary["tracking"]["outside_ticks"], 0);
    assert_eq!(summary["timing"]["missed_ticks"], 0);
}
