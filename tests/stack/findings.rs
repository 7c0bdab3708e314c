//! Values that are valid but unwise: what `hapfic check`, `run` and `set` say about them; `--force`, `--dry-run`, `get`.

use crate::running::{TIMEOUT, start, status_at};
use hapfic_tests::{FinishedProgram, StackSandbox, StartedProgram};
use serde_json::Value;

/// Runs a command without the harness's check for remains, since a run may still use its files.
fn run_command(stack: &StackSandbox, arguments: &[&str], code: i32) -> FinishedProgram {
    let end = stack.run(arguments);
    assert_eq!(end.code, Some(code), "{arguments:?}\nstdout:\n{}\nstderr:\n{}", end.out, end.err);
    end
}

fn stop(stack: &StackSandbox, run: StartedProgram) {
    run_command(stack, &["stop"], 0);
    run.finish().expect(3);
}

/// Writes `floor` with some texts replaced.
fn variant(stack: &StackSandbox, replacements: &[(&str, &str)]) {
    let mut floor = stack.run(&["scenarios", "floor"]).expect(0).out.clone();
    for (from, to) in replacements {
        assert!(floor.contains(from), "found no '{from}' in floor.toml");
        floor = floor.replacen(from, to, 1);
    }
    std::fs::write(stack.path("mine.toml"), floor).unwrap();
}

#[test]
fn check_all_findings_shown_in_order_of_lines() {
    let stack = StackSandbox::new();
    variant(
        &stack,
        &[
            ("duration_s = 10.0", "duration_s = 7.0"),
            ("gravity_m_per_s2 = [0.0, 0.0, -9.81]", "gravity_m_per_s2 = [0.0, 0.0, 9.81]"),
            ("target_position_m = [-0.10, 0.05, 0.06]", "target_position_m = [-0.10, 0.05, 4.5]"),
            ("desired_force_n = [0.0, 0.0, 50.0]", "desired_force_n = [0.0, 0.0, -4000.0]"),
        ],
    );
    let check = run_command(&stack, &["check", "mine.toml"], 0);
    assert!(check.out.contains("mine.toml: valid."), "{}", check.out);
    let mut rest = check.err.as_str();
    for words in [
        "warning: mine.toml:17: world.gravity_m_per_s2: found [0, 0, 9.81] m/s^2, which points upwards",
        "danger: mine.toml:47: operator[0].target_position_m: found [-0.1, 0.05, 4.5] m",
        "danger: mine.toml:55: operator[2].desired_force_n: found F_d = -4000 N on z, expected at most F_max = 300 N",
        "warning: mine.toml:55: operator[2].desired_force_n: found F_d = [0, 0, -4000] N, which points into the floor",
        "warning: mine.toml:66: operator[5].at_s: found 8.2 s, after the end of the run, expected less than duration_s = 7",
    ] {
        let at = rest.find(words).unwrap_or_else(|| panic!("'{words}' is not in order in\n{}", check.err));
        rest = &rest[at + words.len()..];
    }
}

#[test]
fn check_angles_in_degrees_get_hint() {
    let stack = StackSandbox::new();
    variant(&stack, &[("start_position_rad = [0.0, 0.9, -1.8]", "start_position_rad = [0.0, 50, -100]")]);
    for command in [&["check", "mine.toml"][..], &["run", "mine.toml", "--clock", "lockstep"]] {
        let err = run_command(&stack, command, 2).err;
        assert!(err.contains("robot.start_position_rad[1]") && err.contains("write [0, 0.8727, -1.745]"), "{err}");
    }
    // The robot has three joints: the posture is wrong, not the damping.
    variant(&stack, &[("[0.0, 0.9, -1.8]", "[0.0, 0.9]\njoint_damping_n_m_s_per_rad = [1, 2, 3]")]);
    let err = run_command(&stack, &["check", "mine.toml"], 2).err;
    assert!(err.contains("robot.start_position_rad: found 2 values, expected 3, one for each joint"), "{err}");
}

#[test]
fn run_says_findings_before_it_starts() {
    let stack = StackSandbox::new();
    let force = "operator.2.desired_force=[0, 0, -50]";
    let run = ["run", "floor", "--clock", "lockstep", "--duration", "3.1", "--log", "run.mcap", "--set", force];
    let end = stack.run(&run);
    end.expect(0);
    assert!(
        end.err.contains(&format!("warning: --set {force}: operator[2].desired_force_n: found F_d = [0, 0, -50] N")),
        "{}",
        end.err
    );
    assert!(!end.err.contains("after the end"), "--duration leaves entries out on purpose: {}", end.err);
}

#[test]
fn set_dangerous_change_needs_force() {
    let stack = StackSandbox::new();
    let run = start(&stack, "run", "lockstep");
    status_at(&stack, 50);
    for (pair, words) in [
        ("target_position.z=-0.3", "inside the floor"),
        ("target_position.z=5", "out of reach"),
        ("desired_force.z=4000", "F_max = 300 N"),
        ("max_force=[10000,10000,10000]", "times its effort of 80 N m"),
        ("stiffness=[18000,18000,36000]", "oscillates ("),
    ] {
        let rejected = run_command(&stack, &["set", pair], 2).err;
        for word in ["nothing changed", "danger: set ", pair, words, "--force"] {
            assert!(rejected.contains(word), "{pair}: '{word}' is not in\n{rejected}");
        }
        let dry = run_command(&stack, &["set", "--dry-run", pair], 0).out;
        for word in ["nothing changed (dry run)", " -> ", "danger: set ", words, "it would need --force"] {
            assert!(dry.contains(word), "{pair}: '{word}' is not in\n{dry}");
        }
    }
    assert_eq!(status_at(&stack, 0)["announced_version"], 1, "a rejected change or a dry run has changed something");

    let forced = run_command(&stack, &["set", "--force", "target_position.z=5"], 0).out;
    assert!(forced.contains("parameters 2 in force") && forced.contains("danger: set target_position.z=5"), "{forced}");
    let begun = std::time::Instant::now();
    while !run_command(&stack, &["status", "--once"], 0).out.contains("task: outside_bound on z since ") {
        assert!(begun.elapsed() < TIMEOUT, "the status does not show that the target is not reached");
    }
    // A mere warning needs no consent.
    let pulling = run_command(&stack, &["set", "target_position=[-0.1, 0.05, 0.06]", "desired_force.z=-20"], 0).out;
    assert!(pulling.contains("parameters 3 in force"), "{pulling}");
    assert!(pulling.contains("warning: set desired_force.z=-20: desired_force: found F_d = [0, 0, -20] N"), "{pulling}");
    let quiet = run_command(&stack, &["set", "target_position.z=0.01", "desired_force.z=20"], 0).out;
    assert!(!quiet.contains("warning") && !quiet.contains("danger"), "{quiet}");
    assert_eq!(stack.run(&["set", "--force", "--dry-run", "taper=0.1"]).code, Some(2));
    stop(&stack, run);
}

#[test]
fn get_prints_values_that_set_accepts() {
    let stack = StackSandbox::new();
    let run = start(&stack, "run", "lockstep");
    status_at(&stack, 50);
    let set = run_command(&stack, &["set", "desired_force.z=30", "search=sign", "taper=0.125"], 0).out;
    let effective: i64 = set.split("from tick ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    status_at(&stack, effective + 200);
    let all = run_command(&stack, &["get"], 0).out;
    for line in ["desired_force_n = [0, 0, 30]", "search = \"sign\"", "taper = 0.125", "stiffness_n_per_m = [6000, 6000, 12000]"]
    {
        assert!(all.lines().any(|l| l == line), "'{line}' is not in\n{all}");
    }
    let pairs: Vec<&str> = all.lines().collect();
    let same = run_command(&stack, &[&["set"][..], &pairs[..]].concat(), 0).out;
    assert!(same.contains("no value differs"), "{same}");
    assert_eq!(run_command(&stack, &["get", "taper", "desired_force.z"], 0).out.trim(), "taper = 0.125\ndesired_force_n.z = 30");
    let json: Value = serde_json::from_str(&run_command(&stack, &["get", "--json", "search", "stiffness"], 0).out).unwrap();
    assert_eq!(json, serde_json::json!({ "search": "sign", "stiffness_n_per_m": [6000, 6000, 12000] }));
    assert!(run_command(&stack, &["get", "tapr"], 2).err.contains("did you mean taper?"));
    stop(&stack, run);
}

#[test]
fn run_force_never_reached_says_so_with_its_error() {
    let stack = StackSandbox::new();
    let slow = ["--duration", "4.2", "--set", "controller.search=tapered", "--set", "controller.search_scale=0.00001"];
    let run = stack
        .run(&[&["run", "floor", "--clock", "lockstep", "--log", "run.mcap", "--summary-json", "run.json"][..], &slow].concat());
    run.expect(0);
    let line = |name: &str| run.out.lines().find(|l| l.trim_start().starts_with(name)).unwrap_or_default().to_owned();
    assert!(line("settled rms").ends_with("not reached"), "{}", run.out);
    assert!(line("F_d missed by").ends_with(" N"), "{}", run.out);
    let summary: Value = serde_json::from_str(&std::fs::read_to_string(stack.path("run.json")).unwrap()).unwrap();
    assert_eq!(summary["force"]["not_reached"], serde_json::json!([0, 0, 1]));
    assert!(summary["force"]["not_reached_error_n"][2].as_f64().unwrap().abs() > 1.0);
    let one = stack.run(&[&["simulate", "floor"][..], &slow].concat()).expect(0).out.clone();
    assert!(one.contains("z not reached % of F_d") && one.contains("F_d missed by"), "{one}");
    let sweep = stack.run(&[&["simulate", "floor", "--sweep", "seed=1,2"][..], &slow].concat()).expect(0).out.clone();
    assert_eq!(sweep.matches("not reached").count(), 2, "{sweep}");
    stack.run(&["report", "run.mcap", "--json", "report.json"]).expect(0);
    let report: Value = serde_json::from_str(&std::fs::read_to_string(stack.path("report.json")).unwrap()).unwrap();
    assert!(report["metrics"]["force"]["not_reached_error_n"][2].is_number());
    // The condition is no fault, and its time is in the report.
    let tasks = report["tasks"].as_array().unwrap();
    let task = tasks.iter().find(|task| task["condition"] == "force_not_reached on z").unwrap();
    assert!(task["times"] == 1 && task["total_s"].as_f64().unwrap() > 0.1, "{task}");
    let listed = report["events"]["listed"].as_array().unwrap();
    assert!(listed.iter().filter(|event| event["kind"] == "condition").all(|event| event["fault"] == false), "{listed:?}");
}
