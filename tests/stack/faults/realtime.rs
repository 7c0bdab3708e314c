//! Realtime: what each loss leads to, by the events and commands of the log.

use super::trace::Trace;
use crate::log_file::expect_complete;
use crate::realtime::alone;
use hapfic_tests::{Stack, Started};
use std::time::{Duration, Instant};

const RUN: [&str; 4] = ["run", "floor", "--log", "run.mcap"];

fn run(faults: &str, seconds: &str, more: &[&str]) -> (Stack, Trace) {
    let stack = Stack::new();
    stack.run(&[&RUN[..], &["--set", faults, "--duration", seconds], more].concat()).expect(0);
    // A state that is no good is rejected by the recorder, too.
    if !faults.contains("plant") {
        expect_complete(&stack.path("run.mcap"));
    }
    let trace = Trace::read(&stack.path("run.mcap"));
    (stack, trace)
}

/// Lost by a detector, started again, back.
fn expect_replaced(trace: &Trace, process: &str, detector: &str) {
    let text = trace.text();
    let lost = trace.events("lost", process);
    assert!(lost.iter().any(|e| e.detector == detector), "{process} by {detector}:\n{text}");
    assert!(!trace.events("restarted", process).is_empty(), "{process}:\n{text}");
    assert!(!trace.events("joined", process).is_empty(), "{process}:\n{text}");
}

#[test]
fn the_standby_takes_over_and_a_new_one_is_started() {
    let _alone = alone();
    let (_stack, trace) = run("fault=[{kind=\"kill\",process=\"controller\",at_s=1.0}]", "3", &[]);
    expect_replaced(&trace, "controller", "exit");
    assert!(trace.fresh_from("controller") > 500 && trace.fresh_from("standby") > 500, "{}", trace.text());
    let last = trace.commands.last().unwrap();
    assert_eq!((last.source.as_str(), last.mode.as_str()), ("fresh", "active"));
}

#[test]
fn a_halted_controller_is_replaced_by_its_heartbeat_and_a_short_halt_is_borne() {
    let _alone = alone();
    let faults = "fault=[{kind=\"stop\",process=\"controller\",at_s=0.5,for_ms=600000},{kind=\"stop\",process=\"planner\",at_s=2.5,for_ms=30}]";
    let (_stack, trace) =
        run(faults, "4", &["--set", "supervisor.heartbeat_timeout_ms=400", "--set", "supervisor.tick_timeout_ms=5000"]);
    expect_replaced(&trace, "controller", "heartbeat");
    assert!(trace.events("lost", "planner").is_empty(), "{}", trace.text());
}

#[test]
fn a_planner_goes_on_from_its_last_reference() {
    let _alone = alone();
    let (_stack, trace) = run("fault=[{kind=\"kill\",process=\"planner\",at_s=1.0}]", "3", &[]);
    expect_replaced(&trace, "planner", "exit");
    assert!(trace.events("restarted", "planner")[0].text.contains("goes on from tick"), "{}", trace.text());
}

#[test]
fn without_controllers_the_drive_brakes_and_the_torque_ramps_in_again() {
    let _alone = alone();
    let faults = "fault=[{kind=\"kill\",process=\"controllers\",at_s=3.3}]";
    // With the leg's weight to hold there is a torque to ramp in.
    let (stack, trace) = run(faults, "4.5", &["--set", "controller.gravity_compensation=true"]);
    for process in ["controller", "standby"] {
        expect_replaced(&trace, process, "exit");
    }
    assert_eq!(trace.events("injected", "supervisor").len(), 1);
    // The event is written some time after the signal; on a busy machine a tick may have gone by.
    let after = trace.commands.iter().filter(|c| c.tick >= 3300);
    let sources: Vec<_> =
        after.clone().skip_while(|c| c.source == "fresh").take(2).map(|c| (&c.source[..], &c.mode[..])).collect();
    assert_eq!(sources, [("repeated", "active"), ("none", "brake")], "once more, then brake:\n{}", trace.text());
    // 20 good ticks, then the torque again.
    let good = after.clone().filter(|c| c.source == "withheld").count();
    assert!(good >= 19, "{good} ticks were good before the torque came back");
    assert!(after.clone().any(|c| c.ramped != 0), "the torque does not ramp in");
    let step = trace.largest_ramped_step();
    assert!(step <= 2.0 + 1e-9, "a ramp step of {step} N m, the rate allows 2");
    assert_eq!(trace.commands.last().unwrap().mode, "active");
    // The post-mortem.
    let report = std::fs::read_to_string(stack.path("run.incidents.md")).unwrap();
    for words in [
        "brake at tick",
        "What happened",
        "kill controllers",
        "Seen first by",
        "time to brake",
        "time to recover",
        "Torques of the last 10 ticks",
    ] {
        assert!(report.contains(words), "'{words}' is not in:\n{report}");
    }
}

#[test]
fn a_plant_is_started_again_if_that_is_wished() {
    let _alone = alone();
    let (_stack, trace) = run("fault=[{kind=\"kill\",process=\"plant\",at_s=1.0}]", "3", &["--set", "plant.on_loss=restart"]);
    expect_replaced(&trace, "plant", "exit");
}

#[test]
fn bad_messages_are_refused_counted_and_logged() {
    let _alone = alone();
    for (process, kind) in [
        ("controller", "nan"),
        ("controller", "stale"),
        ("controller", "repeat"),
        ("controller", "corrupt"),
        ("plant", "nan"),
        ("plant", "corrupt"),
        ("plant", "stale"),
        ("planner", "nan"),
        ("planner", "stale"),
        ("planner", "corrupt"),
    ] {
        let faults = format!("fault=[{{kind=\"{kind}\",process=\"{process}\",at_s=0.5,for_ms=2}}]");
        let (_stack, trace) = run(&faults, "0.8", &[]);
        let rejected = trace.events.iter().filter(|e| e.kind == "rejected" && e.detector == "check").count();
        assert!(rejected > 0, "{kind} of {process}:\n{}", trace.text());
    }
}

/// Waits until `status` says what is wished.
fn until(stack: &Stack, wished: impl Fn(&serde_json::Value) -> bool) -> serde_json::Value {
    let begun = Instant::now();
    loop {
        let end = stack.run(&["status", "--json"]);
        if let Ok(status) = serde_json::from_str(&end.out)
            && wished(&status)
        {
            return status;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "{}\n{}", end.out, end.err);
    }
}

fn ask(stack: &Stack, words: &[&str], code: i32) -> String {
    let end = stack.run(words);
    assert_eq!(end.code, Some(code), "{words:?}\n{}\n{}", end.out, end.err);
    format!("{}{}", end.out, end.err)
}

fn start(stack: &Stack, clock: &str) -> Started {
    // With the leg's weight to hold there is a torque to ramp in.
    let weight = "controller.gravity_compensation=true";
    stack.start(&["run", "floor", "--duration", "3600", "--clock", clock, "--log", "run.mcap", "--set", weight])
}

#[test]
fn an_emergency_stop_is_latched_and_left_only_by_rearming() {
    let _alone = alone();
    for clock in ["realtime", "lockstep"] {
        let stack = Stack::new();
        let run = start(&stack, clock);
        until(&stack, |s| s["tick"].as_i64().unwrap() > 100);
        let rejected = ask(&stack, &["rearm"], 2);
        assert!(rejected.contains("nothing to re-arm"), "{rejected}");
        let answer = ask(&stack, &["estop"], 0);
        assert!(answer.contains("latched stop at tick"), "{answer}");
        let stopped = until(&stack, |s| s["severity"] == "stopped" && s["mode"] == "stopped");
        // Ticks go on, and it stays stopped.
        let tick = stopped["tick"].as_i64().unwrap();
        let later = until(&stack, |s| s["tick"].as_i64().unwrap() > tick + 100);
        assert_eq!(later["severity"], "stopped");
        let answer = ask(&stack, &["rearm"], 0);
        assert!(answer.contains("re-armed"), "{answer}");
        until(&stack, |s| s["severity"] == "nominal" && s["mode"] == "active");
        ask(&stack, &["stop"], 0);
        run.finish().expect(3);
        let trace = Trace::read(&stack.path("run.mcap"));
        let stops: Vec<_> = trace.events("transition", "supervisor").into_iter().filter(|e| e.severity == "stopped").collect();
        assert_eq!((stops.len(), stops[0].detector.as_str()), (1, "operator"), "{clock}:\n{}", trace.text());
        assert_eq!(trace.events("rearmed", "supervisor").len(), 1, "{clock}:\n{}", trace.text());
        assert!(trace.commands.iter().any(|c| c.ramped != 0), "{clock}: the torque does not ramp in");
        let step = trace.largest_ramped_step();
        assert!(step <= 2.0 + 1e-9, "{clock}: a ramp step of {step} N m, the rate allows 2");
    }
}

#[test]
fn a_spent_budget_is_a_latched_stop_which_the_operator_can_leave() {
    let _alone = alone();
    let stack = Stack::new();
    let faults = "fault=[{kind=\"kill\",process=\"planner\",random={count=4,from_s=0.2,to_s=0.5}}]";
    let run = stack.start(&[
        "run",
        "floor",
        "--duration",
        "3600",
        "--log",
        "run.mcap",
        "--set",
        faults,
        "--set",
        "supervisor.restart_budget=3",
    ]);
    until(&stack, |s| s["severity"] == "stopped");
    ask(&stack, &["rearm"], 0);
    until(&stack, |s| s["severity"] == "nominal" && s["mode"] == "active");
    ask(&stack, &["stop"], 0);
    let end = run.finish();
    end.expect(3);
    assert!(end.err.contains("LATCHED STOP: planner was lost once more after 3 restarts"), "{}", end.err);
    let trace = Trace::read(&stack.path("run.mcap"));
    let stopped = trace.events("transition", "supervisor").into_iter().find(|e| e.severity == "stopped").unwrap().clone();
    assert_eq!(stopped.detector, "budget", "{}", trace.text());
    // Three before the stop, one after it was re-armed.
    assert_eq!(trace.events("restarted", "planner").len(), 4, "{}", trace.text());
}

#[test]
fn faults_can_be_made_in_a_running_stack() {
    let _alone = alone();
    let stack = Stack::new();
    let run = start(&stack, "realtime");
    until(&stack, |s| s["tick"].as_i64().unwrap() > 100);
    let answer = ask(&stack, &["inject", "kind=kill", "process=controller"], 0);
    assert!(answer.contains("kill controller"), "{answer}");
    until(&stack, |s| s["primary"] == "standby");
    ask(&stack, &["inject", "kind=nan", "process=standby", "for_ms=2"], 0);
    for (words, expected) in [
        (vec!["inject", "kind=kill"], "process"),
        (vec!["inject", "kind=melt", "process=plant"], "melt"),
        (vec!["inject", "kind=full_disk"], "tmpfs"),
        (vec!["inject", "kind=kill", "proces=plant"], "process"),
    ] {
        let rejected = ask(&stack, &words, 2);
        assert!(rejected.contains(expected), "{words:?}: {rejected}");
    }
    ask(&stack, &["stop"], 0);
    run.finish().expect(3);
    let trace = Trace::read(&stack.path("run.mcap"));
    expect_replaced(&trace, "controller", "exit");
    assert_eq!(trace.events.iter().filter(|e| e.kind == "injected").count(), 2, "{}", trace.text());
}
