//! Bad input: one clear error, exit code 2, no process started, no remains.

use hapfic_tests::{FinishedProgram, StackSandbox};

fn rejected(stack: &StackSandbox, arguments: &[&str], words: &[&str]) -> FinishedProgram {
    let end = stack.run(arguments);
    end.expect(2);
    for word in words {
        assert!(end.err.contains(word), "{arguments:?}: '{word}' is not in\n{}", end.err);
    }
    assert_eq!(stack.registrations(), 0);
    end
}

/// Writes a variant of the embedded scenario `floor`, with one text replaced.
fn variant(stack: &StackSandbox, from: &str, to: &str) -> String {
    let floor = stack.run(&["scenarios", "floor"]).expect(0).out.clone();
    assert!(floor.contains(from), "found no '{from}' in floor.toml");
    std::fs::write(stack.path("mine.toml"), floor.replacen(from, to, 1)).unwrap();
    "mine.toml".to_owned()
}

#[test]
fn run_bad_scenario_rejected() {
    let stack = StackSandbox::new();
    rejected(&stack, &["run", "flor"], &["flor", "floor"]);
    rejected(&stack, &["run", "missing.toml"], &["missing.toml"]);
    for (from, to, words) in [
        ("duration_s = 10.0", "duration_s = nan", vec!["mine.toml:", "duration_s"]),
        ("duration_s = 10.0", "duration = 10.0", vec!["mine.toml:", "duration", "duration_s"]),
        ("duration_s = 10.0", "duration_s = \"long\"", vec!["mine.toml:", "duration_s", "long"]),
        ("duration_s = 10.0", "duration_s = 1e300", vec!["mine.toml:", "duration_s"]),
        ("duration_s = 10.0", "duration_s = ", vec!["mine.toml:"]),
        ("urdf = \"leg.urdf\"", "urdf = \"nowhere.urdf\"", vec!["mine.toml:", "nowhere.urdf"]),
        ("start_position_rad = [0.0, 0.9, -1.8]", "start_position_rad = [0.0, 0.9]", vec!["start_position_rad", "3"]),
        ("start_position_rad = [0.0, 0.9, -1.8]", "start_position_rad = [0.0, 0.9, -9.0]", vec!["start_position_rad", "kfe"]),
        ("tip_link = \"foot\"", "tip_link = \"fooot\"", vec!["fooot", "foot"]),
    ] {
        let file = variant(&stack, from, to);
        rejected(&stack, &["run", &file, "--clock", "lockstep"], &words);
        rejected(&stack, &["check", &file], &words);
    }
}

#[test]
fn run_bad_urdf_rejected() {
    let stack = StackSandbox::new();
    let file = variant(&stack, "urdf = \"leg.urdf\"", "urdf = \"mine.urdf\"");
    let leg = include_str!("../../config/robots/leg.urdf");
    for (from, to, words) in [
        ("type=\"fixed\"", "type=\"floating\"", vec!["ankle", "floating"]),
        ("<child link=\"hip\"/>", "<child link=\"base\"/>", vec!["mine.urdf"]),
        ("<mass value=\"1.0\"/>", "<mass value=\"nan\"/>", vec!["mine.urdf", "hip"]),
        ("<axis xyz=\"1 0 0\"/>", "<axis xyz=\"0 0 0\"/>", vec!["haa", "axis"]),
        ("</robot>", "", vec!["mine.urdf"]),
    ] {
        assert!(leg.contains(from));
        std::fs::write(stack.path("mine.urdf"), leg.replacen(from, to, 1)).unwrap();
        rejected(&stack, &["run", &file, "--clock", "lockstep"], &words);
    }
}

#[test]
fn command_line_bad_words_rejected() {
    let stack = StackSandbox::new();
    rejected(&stack, &["run", "--set", "controller.tapr=0.1"], &["--set", "tapr", "taper"]);
    rejected(&stack, &["run", "--set", "controller.taper=much"], &["--set", "taper", "much"]);
    rejected(&stack, &["run", "--duration", "-1"], &["duration"]);
    rejected(&stack, &["run", "--clock", "sundial"], &["sundial", "lockstep"]);
    rejected(&stack, &["sprint"], &["sprint"]);
    rejected(&stack, &["scenarios", "nothing"], &["nothing", "floor"]);
    rejected(&stack, &["process", "plant"], &["HAPFIC_RUN"]);
}

#[test]
fn run_unwritable_output_rejected() {
    let stack = StackSandbox::new();
    std::fs::write(stack.path("file"), "").unwrap();
    rejected(&stack, &["run", "--log", "file/run.mcap"], &["file"]);
    rejected(&stack, &["run", "--log", "/dev/full"], &["/dev/full"]);
    rejected(&stack, &["run", "--summary-json", "nowhere/summary.json"], &["nowhere/summary.json"]);
    // An existing file stays as it is.
    std::fs::write(stack.path("old.json"), "{\"launch_s\": 1}").unwrap();
    rejected(&stack, &["run", "--summary-json", "old.json", "--log", "/dev/full"], &["/dev/full"]);
    assert_eq!(std::fs::read_to_string(stack.path("old.json")).unwrap(), "{\"launch_s\": 1}");
}

#[test]
fn run_log_of_another_run_rejected() {
    let stack = StackSandbox::new();
    let long = ["run", "floor", "--clock", "lockstep", "--duration", "3600", "--log", "run.mcap"];
    let mut first = stack.start(&long);
    first.wait_for(&stack.path("run.mcap"), 50_000);
    let second = stack.run(&long);
    assert_eq!(second.code, Some(2), "{}", second.err);
    assert!(second.err.contains("run.mcap") && second.err.contains("another run"), "{}", second.err);
    second.expect_nothing_left();
    first.signal(rustix::process::Signal::INT);
    first.finish().expect(3);
    assert!(crate::log_file::expect_complete(&stack.path("run.mcap")) > 50);
}

#[test]
fn run_lockstep_with_realtime_rejected() {
    let stack = StackSandbox::new();
    rejected(&stack, &["run", "--clock", "lockstep", "--realtime", "require"], &["require", "lockstep"]);
}

#[test]
fn run_process_start_failure_reported() {
    let stack = StackSandbox::new();
    let run = ["run", "floor", "--clock", "lockstep", "--log", "run.mcap", "--set"];
    for process in ["plant", "planner", "controller"] {
        let set = format!("processes.{process}=[\"/nonexistent/program\"]");
        rejected(&stack, &[&run[..], &[&set]].concat(), &[&format!("processes.{process}"), "/nonexistent/program"]);
        // A file that is not executable.
        let set = format!("processes.{process}=[\"/etc/passwd\"]");
        rejected(&stack, &[&run[..], &[&set]].concat(), &[&format!("processes.{process}"), "/etc/passwd"]);
    }
    // A program that ends immediately.
    let end = stack.run(&[&run[..], &["processes.planner=[\"true\"]"]].concat());
    end.expect(3);
    assert!(end.out.contains("planner ended with exit code 0"), "{}", end.out);
    // A program that never becomes ready.
    let end =
        stack.run(&[&run[..], &["processes.planner=[\"sleep\", \"1000\"]", "--set", "supervisor.ready_timeout_ms=500"]].concat());
    end.expect(3);
    assert!(end.out.contains("planner did not get ready in time"), "{}", end.out);
}
