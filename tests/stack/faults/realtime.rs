//! Realtime: the reaction to each fault, by the events and commands of the log.

use super::trace::EventTrace;
use crate::log_file::expect_complete;
use crate::realtime::realtime_lock;
use hapfic_tests::{StackSandbox, StartedProgram};
use std::time::{Duration, Instant};

const RUN: [&str; 4] = ["run", "floor", "--log", "run.mcap"];

fn run(faults: &str, seconds: &str, more: &[&str]) -> (StackSandbox, EventTrace) {
    let stack = StackSandbox::new();
    stack.run(&[&RUN[..], &["--set", faults, "--duration", seconds], more].concat()).expect(0);
    // The recorder rejects invalid states too, so their ticks are missing.
    if !faults.contains("plant") {
        expect_complete(&stack.path("run.mcap"));
    }
    let trace = EventTrace::read(&stack.path("run.mcap"));
    (stack, trace)
}

/// Asserts that a process was lost by a detector, restarted, and joined again.
fn expect_replaced(trace: &EventTrace, process: &str, detector: &str) {
    let text = trace.text();
    let lost = trace.events("lost", process);
    assert!(lost.iter().any(|e| e.detector == detector), "{process} by {detector}:\n{text}");
    assert!(!trace.events("restarted", process).is_empty(), "{process}:\n{text}");
    assert!(!trace.events("joined", process).is_empty(), "{process}:\n{text}");
}

#[test]
fn controller_kill_standby_takes_over() {
    let _lock = realtime_lock();
    let (_stack, trace) = run("fault=[{kind=\"kill\",process=\"controller\",at_s=1.0}]", "3", &[]);
    expect_replaced(&trace, "controller", "exit");
    assert!(trace.fresh_from("controller") > 500 && trace.fresh_from("standby") > 500, "{}", trace.text());
    let last = trace.commands.last().unwrap();
    assert_eq!((last.source.as_str(), last.mode.as_str()), ("fresh", "active"));
}

#[test]
fn controller_halt_replaced_by_heartbeat() {
    let _lock = realtime_lock();
    let faults = "fault=[{kind=\"stop\",process=\"controller\",at_s=0.5,for_ms=600000},{kind=\"stop\",process=\"planner\",at_s=2.5,for_ms=30}]";
    let (_stack, trace) =
        run(faults, "4", &["--set", "supervisor.heartbeat_timeout_ms=400", "--set", "supervisor.tick_timeout_ms=5000"]);
    expect_replaced(&trace, "controller", "heartbeat");
    assert!(trace.events("lost", "planner").is_empty(), "{}", trace.text());
}

#[test]
fn planner_restart_continues_from_last_reference() {
    let _lock = realtime_lock();
    let (_stack, trace) = run("fault=[{kind=\"kill\",process=\"planner\",at_s=1.0}]", "3", &[]);
    expect_replaced(&trace, "planner", "exit");
    // The ticks without a planner are a pause of the reference. A planner that began anew would start at the foot, at rest.
    let step = |pair: &[hapfic_log::proto::Reference]| -> [f64; 3] {
        std::array::from_fn(|i| pair[1].position[i] - pair[0].position[i])
    };
    let steps: Vec<_> = trace.references.windows(2).map(step).collect();
    let change = |pair: &[[f64; 3]]| (0..3).map(|i| (pair[1][i] - pair[0][i]).abs()).fold(0.0, f64::max);
    let largest = steps.windows(2).map(change).fold(0.0, f64::max);
    assert!(largest < 1e-5, "the velocity of the reference steps by {largest} m per tick");
}

#[test]
fn both_controllers_kill_brakes_then_ramps() {
    let _lock = realtime_lock();
    let faults = "fault=[{kind=\"kill\",process=\"controllers\",at_s=3.3}]";
    // Gravity compensation gives a torque that ramps in.
    let (stack, trace) = run(faults, "4.5", &["--set", "controller.gravity_compensation=true"]);
    for process in ["controller", "standby"] {
        expect_replaced(&trace, process, "exit");
    }
    assert_eq!(trace.events("injected", "supervisor").len(), 1);
    // The event follows the signal after some time; on a busy machine a tick may pass in between.
    let after = trace.commands.iter().filter(|c| c.tick >= 3300);
    let sources: Vec<_> =
        after.clone().skip_while(|c| c.source == "fresh").take(2).map(|c| (&c.source[..], &c.mode[..])).collect();
    assert_eq!(sources, [("repeated", "active"), ("none", "brake")], "expected one repetition, then a brake:\n{}", trace.text());
    // 20 good ticks before the torque returns.
    let good = after.clone().filter(|c| c.source == "suppressed").count();
    assert!(good >= 19, "found {good} good ticks before the torque, expected 19 or more");
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
        "First detected by",
        "time to brake",
        "time to recover",
        "Torques of the last 10 ticks",
    ] {
        assert!(report.contains(words), "'{words}' is not in:\n{report}");
    }
}

#[test]
fn plant_kill_on_loss_restart_replaced() {
    let _lock = realtime_lock();
    let (_stack, trace) = run("fault=[{kind=\"kill\",process=\"plant\",at_s=1.0}]", "3", &["--set", "plant.on_loss=restart"]);
    expect_replaced(&trace, "plant", "exit");
}

#[test]
fn bad_messages_rejected_and_logged() {
    let _lock = realtime_lock();
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

/// Waits until `hapfic status` satisfies a condition, and returns it.
fn until(stack: &StackSandbox, condition: impl Fn(&serde_json::Value) -> bool) -> serde_json::Value {
    let begun = Instant::now();
    loop {
        let end = stack.run(&["status", "--json"]);
        if let Ok(status) = serde_json::from_str(&end.out)
            && condition(&status)
        {
            return status;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "{}\n{}", end.out, end.err);
    }
}

fn run_command(stack: &StackSandbox, words: &[&str], code: i32) -> String {
    let end = stack.run(words);
    assert_eq!(end.code, Some(code), "{words:?}\n{}\n{}", end.out, end.err);
    format!("{}{}", end.out, end.err)
}

fn start(stack: &StackSandbox, clock: &str) -> StartedProgram {
    // Gravity compensation gives a torque that ramps in.
    let weight = "controller.gravity_compensation=true";
    stack.start(&["run", "floor", "--duration", "3600", "--clock", clock, "--log", "run.mcap", "--set", weight])
}

#[test]
fn estop_latched_until_rearm() {
    let _lock = realtime_lock();
    for clock in ["realtime", "lockstep"] {
        let stack = StackSandbox::new();
        let run = start(&stack, clock);
        until(&stack, |s| s["tick"].as_i64().unwrap() > 100);
        let rejected = run_command(&stack, &["rearm"], 2);
        assert!(rejected.contains("nothing to re-arm"), "{rejected}");
        let reply = run_command(&stack, &["estop"], 0);
        assert!(reply.contains("latched stop at tick"), "{reply}");
        let stopped = until(&stack, |s| s["severity"] == "stopped" && s["mode"] == "stopped");
        // Ticks continue, and the stop stays.
        let tick = stopped["tick"].as_i64().unwrap();
        let later = until(&stack, |s| s["tick"].as_i64().unwrap() > tick + 100);
        assert_eq!(later["severity"], "stopped");
        let reply = run_command(&stack, &["rearm"], 0);
        assert!(reply.contains("re-armed"), "{reply}");
        until(&stack, |s| s["severity"] == "nominal" && s["mode"] == "active");
        run_command(&stack, &["stop"], 0);
        run.finish().expect(3);
        let trace = EventTrace::read(&stack.path("run.mcap"));
        let stops: Vec<_> = trace.events("transition", "gate").into_iter().filter(|e| e.severity == "stopped").collect();
        assert_eq!((stops.len(), stops[0].detector.as_str()), (1, "operator"), "{clock}:\n{}", trace.text());
        assert_eq!(trace.events("rearmed", "gate").len(), 1, "{clock}:\n{}", trace.text());
        assert!(trace.commands.iter().any(|c| c.ramped != 0), "{clock}: the torque does not ramp in");
        let step = trace.largest_ramped_step();
        assert!(step <= 2.0 + 1e-9, "{clock}: a ramp step of {step} N m, the rate allows 2");
    }
}

#[test]
fn restart_budget_spent_latched_until_rearm() {
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
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
    run_command(&stack, &["rearm"], 0);
    until(&stack, |s| s["severity"] == "nominal" && s["mode"] == "active");
    run_command(&stack, &["stop"], 0);
    let end = run.finish();
    end.expect(3);
    assert!(end.err.contains("LATCHED STOP: planner was lost once more after 3 restarts"), "{}", end.err);
    let trace = EventTrace::read(&stack.path("run.mcap"));
    let stopped = trace.events("transition", "gate").into_iter().find(|e| e.severity == "stopped").unwrap().clone();
    assert_eq!(stopped.detector, "budget", "{}", trace.text());
    // Three restarts before the stop, one after `rearm`.
    assert_eq!(trace.events("restarted", "planner").len(), 4, "{}", trace.text());
}

#[test]
fn inject_running_stack_faults_happen() {
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
    let run = start(&stack, "realtime");
    until(&stack, |s| s["tick"].as_i64().unwrap() > 100);
    let reply = run_command(&stack, &["inject", "kind=kill", "process=controller"], 0);
    assert!(reply.contains("kill controller"), "{reply}");
    until(&stack, |s| s["primary"] == "standby");
    run_command(&stack, &["inject", "kind=nan", "process=standby", "for_ms=2"], 0);
    for (words, expected) in [
        (vec!["inject", "kind=kill"], "process"),
        (vec!["inject", "kind=melt", "process=plant"], "melt"),
        (vec!["inject", "kind=full_disk"], "tmpfs"),
        (vec!["inject", "kind=kill", "proces=plant"], "process"),
    ] {
        let rejected = run_command(&stack, &words, 2);
        assert!(rejected.contains(expected), "{words:?}: {rejected}");
    }
    run_command(&stack, &["stop"], 0);
    run.finish().expect(3);
    let trace = EventTrace::read(&stack.path("run.mcap"));
    expect_replaced(&trace, "controller", "exit");
    assert_eq!(trace.events.iter().filter(|e| e.kind == "injected").count(), 2, "{}", trace.text());
}
