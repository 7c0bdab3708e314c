//! `hapfic simulate`: the same results as the processes, and the same study on any number of threads.

use crate::log_file::{expect_complete, streams};
use hapfic_tests::StackSandbox;
use rustix::process::Signal;
use serde_json::Value;

/// Topics of a log of `hapfic simulate`.
const SIMULATED: [&str; 7] = ["/state", "/reference", "/request", "/command", "/operator", "/tf", "/scene"];

#[test]
fn simulate_log_same_as_lockstep() {
    let stack = StackSandbox::new();
    // The second run ends between the announcement of a change and its effective tick.
    for (scenario, duration) in [("floor", "1"), ("floor", "0.197"), ("box", "2")] {
        stack.run(&["run", scenario, "--clock", "lockstep", "--duration", duration, "--log", "processes.mcap"]).expect(0);
        stack.run(&["simulate", scenario, "--duration", duration, "--log", "one.mcap"]).expect(0);
        let ticks = expect_complete(&stack.path("one.mcap"));
        assert_eq!(ticks as f64, 1000.0 * duration.parse::<f64>().unwrap());
        let (processes, one) = (streams(&stack.path("processes.mcap")), streams(&stack.path("one.mcap")));
        for topic in SIMULATED {
            let (a, b) = (&processes[topic], &one[topic]);
            assert_eq!(a.len(), b.len(), "{scenario} {duration}: {topic}");
            for (i, (a, b)) in a.iter().zip(b).enumerate() {
                assert_eq!(a, b, "{scenario} {duration}: {topic}, message {i}");
            }
        }
        assert_eq!(one.keys().map(String::as_str).filter(|topic| !SIMULATED.contains(topic)).count(), 0);
    }
}

#[test]
fn simulate_summary_same_as_lockstep() {
    let stack = StackSandbox::new();
    let run = ["run", "floor", "--clock", "lockstep", "--duration", "4", "--log", "p.mcap", "--summary-json", "p.json"];
    stack.run(&run).expect(0);
    let processes: Value = serde_json::from_str(&std::fs::read_to_string(stack.path("p.json")).unwrap()).unwrap();
    let json = stack.run(&["simulate", "floor", "--duration", "4", "--log", "one.mcap", "--json"]).expect(0).out.clone();
    let study: Value = serde_json::from_str(&json).unwrap();
    let one = &study["runs"][0];
    assert_eq!(one["completed"], true);
    for group in ["tracking", "force", "force_command", "moments", "integration", "ticks"] {
        assert_eq!(one["metrics"][group], processes[group], "{group}");
    }
    assert_eq!(one["settled_rms_z_percent"], processes["force"]["settled_rms_percent"][2]);
    assert!(study["speed"].as_f64().unwrap() > 0.0 && study["simulated_s"] == 4.0);

    stack.run(&["report", "one.mcap", "--json", "report.json"]).expect(0);
    assert!(std::fs::read_to_string(stack.path("report.json")).unwrap().contains("settled_rms_percent"));
    let entries = stack.run(&["timeline", "one.mcap"]).expect(0).out.clone();
    assert!(entries.matches("[[operator]]").count() > 2, "{entries}");
}

#[test]
fn study_number_of_jobs_same_result() {
    let stack = StackSandbox::new();
    let study = |jobs: &str, csv: &str| {
        let sweeps = ["--sweep", "operator.2.desired_force=[0, 0, 20],[0, 0, 80]", "--sweep", "controller.taper=0.02:0.04:3"];
        let mut all = vec!["simulate", "floor", "--duration", "3.8", "--jobs", jobs, "--csv", csv];
        all.extend(sweeps);
        let out = stack.run(&all).expect(0).out.clone();
        (std::fs::read_to_string(stack.path(csv)).unwrap(), out)
    };
    let ((one_job, printed), (two_jobs, printed_by_two)) = (study("1", "one.csv"), study("2", "two.csv"));
    assert_eq!(one_job, two_jobs);
    let rows = |text: &str| text.lines().take(7).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(rows(&printed), rows(&printed_by_two));
    assert!(printed.contains("6 runs, 22.800 s simulated in") && printed.contains("(1 job)"), "{printed}");
    let lines: Vec<&str> = one_job.lines().collect();
    assert_eq!(lines.len(), 7, "{one_job}");
    assert!(lines[0].starts_with("operator.2.desired_force,controller.taper,completed,error,"), "{}", lines[0]);
    assert!(lines[1].starts_with("\"[0, 0, 20]\",0.02,true,,3.8,"), "{}", lines[1]);
    assert!(lines[6].starts_with("\"[0, 0, 80]\",0.04,true,,3.8,"), "{}", lines[6]);
    let figures: std::collections::BTreeSet<_> = lines[1..].iter().map(|line| line.split_once("true").unwrap().1).collect();
    assert_eq!(figures.len(), 6, "expected other figures for other values, found:\n{one_job}");
}

#[test]
fn study_bad_arguments_rejected_before_run() {
    let stack = StackSandbox::new();
    std::fs::write(stack.path("kept.csv"), "kept\n").unwrap();
    let rejected = |arguments: &[&str]| {
        let mut all = vec!["simulate", "floor", "--csv", "kept.csv"];
        all.extend(arguments);
        let end = stack.run(&all);
        end.expect(2);
        assert_eq!((end.out.as_str(), std::fs::read_to_string(stack.path("kept.csv")).unwrap().as_str()), ("", "kept\n"));
        end.err.clone()
    };
    // The error of the last value of the last sweep is that of `--set`.
    let swept = rejected(&["--sweep", "seed=1,2", "--sweep", "controller.taper=0.1,0.2,-1"]);
    let set = stack.run(&["check", "floor", "--set", "controller.taper=-1"]).expect(2).err.clone();
    assert_eq!(swept, set);
    let swept = rejected(&["--sweep", "controller.tapper=0.1,0.2"]);
    let set = stack.run(&["check", "floor", "--set", "controller.tapper=0.1"]).expect(2).err.clone();
    assert_eq!(swept, set);
    assert!(rejected(&["--sweep", "controller.taper"]).contains("found no =, expected KEY=V1,V2,..."));
    assert!(rejected(&["--duration", "-1"]).contains("duration_s"));
    assert!(
        rejected(&["--set", "fault=[{kind=\"kill\",process=\"plant\",at_s=1}]"])
            .contains("expected none: there are no processes")
    );
    assert!(rejected(&["--set", "processes.plant=[\"true\"]"]).contains("external process for the plant"));
    rejected(&["--log", "."]);
    assert!(rejected(&["--jobs", "0"]).contains("--jobs"));
    let end = stack.run(&["simulate", "floor", "--csv", "no/such/folder.csv"]);
    assert!(end.expect(2).err.contains("--csv no/such/folder.csv: cannot be written"));
}

#[test]
fn study_signal_leaves_complete_lines() {
    let stack = StackSandbox::new();
    let sweep = ["simulate", "floor", "--duration", "0.5", "--sweep", "seed=1:5000:5000", "--csv", "cut.csv", "--jobs", "2"];
    let mut study = stack.start(&sweep);
    // Some runs have ended by then.
    study.wait_for(&stack.path("cut.csv"), 4000);
    study.signal(Signal::INT);
    let end = study.finish();
    end.expect(3);
    assert!(end.err.contains("interrupted after") && end.err.contains("of 5000 runs"), "{}", end.err);
    let csv = std::fs::read_to_string(stack.path("cut.csv")).unwrap();
    assert!(csv.ends_with('\n'));
    let cells = |line: &str| line.split(',').count();
    let rows: Vec<&str> = csv.lines().skip(1).collect();
    assert!((2..5000).contains(&rows.len()), "{}", rows.len());
    for (index, row) in rows.iter().enumerate() {
        assert!(row.starts_with(&format!("{},true,", index + 1)) && cells(row) == cells(csv.lines().next().unwrap()), "{row}");
    }
}
