//! Lockstep: the loss of a process only pauses the clock.

use super::runs::UNLIMITED_RESTARTS;
use super::trace::EventTrace;
use crate::log_file::{Streams, expect_complete, streams};
use hapfic_tests::StackSandbox;
use prost::Message;

const BASE: [&str; 4] = ["run", "floor", "--clock", "lockstep"];

fn run(stack: &StackSandbox, log: &str, more: &[&str]) -> Streams {
    stack.run(&[&BASE[..], &["--log", log], more].concat()).expect(0);
    expect_complete(&stack.path(log));
    streams(&stack.path(log))
}

/// Commands without their controller, the only field that a fault may change.
fn commands_without_controller(streams: &Streams) -> Vec<Vec<u8>> {
    let command = |(_, bytes): &(u64, Vec<u8>)| {
        let decoded = hapfic_log::proto::Command::decode(&bytes[..]).unwrap();
        hapfic_log::proto::Command { controller: String::new(), ..decoded }.encode_to_vec()
    };
    streams["/command"].iter().map(command).collect()
}

pub(super) fn expect_undisturbed(disturbed: &Streams, undisturbed: &Streams) {
    // Every part of a log repeats the parameter sets that may be in force.
    let sets = |streams: &Streams| streams["/operator"].iter().cloned().collect::<std::collections::BTreeSet<_>>();
    assert_eq!(sets(disturbed), sets(undisturbed), "/operator");
    for topic in ["/state", "/reference"] {
        assert_eq!(disturbed[topic].len(), undisturbed[topic].len(), "{topic}");
        let first = disturbed[topic].iter().zip(&undisturbed[topic]).position(|(a, b)| a != b);
        assert_eq!(first, None, "{topic}: the first message that differs");
    }
    let (a, b) = (commands_without_controller(disturbed), commands_without_controller(undisturbed));
    assert_eq!(a.len(), b.len());
    assert_eq!(a.iter().zip(&b).position(|(a, b)| a != b), None, "/command: the first message that differs");
}

#[test]
fn lockstep_two_hundred_kills_same_torque() {
    let stack = StackSandbox::new();
    // Kills of a process that still restarts wait for it. Where the machine is busy they pile up, so the run goes on for
    // some seconds behind the last one.
    let duration = ["--duration", "16"];
    let undisturbed = run(&stack, "undisturbed.mcap", &duration);
    // 150 kills of one process and 25 of both controllers.
    let faults = "fault=[{kind=\"kill\",process=[\"controller\",\"standby\",\"planner\"],random={count=150,from_s=0.0,to_s=9.5}},\
                  {kind=\"kill\",process=\"controllers\",random={count=25,from_s=0.0,to_s=9.5}}]";
    let disturbed = run(&stack, "disturbed.mcap", &[&duration[..], &UNLIMITED_RESTARTS[..], &["--set", faults]].concat());
    expect_undisturbed(&disturbed, &undisturbed);
    let trace = EventTrace::read(&stack.path("disturbed.mcap"));
    let killed = trace.events.iter().filter(|e| e.kind == "lost" && e.text.contains("SIGKILL")).count();
    assert_eq!(killed, 200, "{}", trace.text());
    assert!(trace.commands.iter().all(|c| c.source == "fresh" && c.mode == "active"));
    assert!(trace.fresh_from("controller") > 0 && trace.fresh_from("standby") > 0, "a controller was never the primary");
}

#[test]
fn lockstep_plant_restart_same_bytes() {
    let stack = StackSandbox::new();
    let scenario = ["--duration", "4"];
    let undisturbed = run(&stack, "undisturbed.mcap", &scenario);
    let faults = "fault=[{kind=\"kill\",process=\"plant\",random={count=12,from_s=0.0,to_s=3.9}},\
                  {kind=\"kill\",process=[\"controller\",\"planner\",\"standby\"],random={count=6,from_s=0.0,to_s=3.9}}]";
    let more = [&UNLIMITED_RESTARTS[..], &scenario, &["--set", "plant.on_loss=restart", "--set", faults]].concat();
    let disturbed = run(&stack, "disturbed.mcap", &more);
    expect_undisturbed(&disturbed, &undisturbed);
    let trace = EventTrace::read(&stack.path("disturbed.mcap"));
    assert_eq!(trace.events("lost", "plant").len(), 12, "{}", trace.text());
}

#[test]
fn lockstep_hanging_process_replaced_by_heartbeat() {
    let stack = StackSandbox::new();
    let scenario = ["--duration", "2"];
    let undisturbed = run(&stack, "undisturbed.mcap", &scenario);
    let faults = "fault=[{kind=\"stop\",process=\"planner\",at_s=0.5,for_ms=600000},\
                  {kind=\"stop\",process=\"controller\",at_s=1.0,for_ms=600000}]";
    let more = [&scenario[..], &["--set", faults, "--set", "supervisor.heartbeat_timeout_ms=200"]].concat();
    let disturbed = run(&stack, "disturbed.mcap", &more);
    expect_undisturbed(&disturbed, &undisturbed);
    let trace = EventTrace::read(&stack.path("disturbed.mcap"));
    for process in ["planner", "controller"] {
        let lost = trace.events("lost", process);
        assert!(!lost.is_empty() && lost[0].detector == "heartbeat", "{process}:\n{}", trace.text());
        assert!(!trace.events("joined", process).is_empty(), "{process}:\n{}", trace.text());
    }
}

#[test]
fn lockstep_bad_messages_rejected_without_effect() {
    let stack = StackSandbox::new();
    let scenario = ["--duration", "1.5", "--set", "supervisor.stall_timeout_ms=500"];
    let undisturbed = run(&stack, "undisturbed.mcap", &scenario);
    let trace = EventTrace::read(&stack.path("undisturbed.mcap"));
    assert!(trace.events.iter().all(|e| e.kind != "rejected"), "{}", trace.text());
    for (process, kind) in [
        ("controller", "nan"),
        ("controller", "corrupt"),
        ("controller", "stale"),
        ("standby", "nan"),
        ("planner", "nan"),
        ("planner", "corrupt"),
    ] {
        let faults = format!("fault=[{{kind=\"{kind}\",process=\"{process}\",at_s=0.8,for_ms=3}}]");
        let disturbed = run(&stack, "disturbed.mcap", &[&scenario[..], &["--set", &faults]].concat());
        expect_undisturbed(&disturbed, &undisturbed);
        let trace = EventTrace::read(&stack.path("disturbed.mcap"));
        let rejected = trace.events.iter().filter(|e| e.kind == "rejected" && e.detector == "check").count();
        // The gate reports each bad request, and the supervisor restarts the controller after an unusable one. The
        // controllers reject the planner's references.
        let each = process != "planner" && kind != "stale";
        assert!(rejected >= if each { 3 } else { 1 }, "{kind} of {process}:\n{}", trace.text());
        if each {
            let requests = trace.events("rejected", process).iter().filter(|e| e.text.contains("request rejected")).count();
            assert_eq!(requests, 3, "{kind} of {process}:\n{}", trace.text());
        }
        assert_eq!(trace.events("injected", process).len(), 1, "{kind} of {process}:\n{}", trace.text());
    }
}

#[test]
fn lockstep_controller_invalid_requests_replaced() {
    let stack = StackSandbox::new();
    let scenario = ["--duration", "1.5"];
    let undisturbed = run(&stack, "undisturbed.mcap", &scenario);
    let faults = "fault=[{kind=\"nan\",process=\"controller\",at_s=0.8,for_ms=400}]";
    let disturbed = run(&stack, "disturbed.mcap", &[&scenario[..], &["--set", faults]].concat());
    expect_undisturbed(&disturbed, &undisturbed);
    let trace = EventTrace::read(&stack.path("disturbed.mcap"));
    let lost = trace.events("lost", "controller");
    assert!(!lost.is_empty() && lost[0].detector == "check", "{}", trace.text());
    assert!(!trace.events("joined", "controller").is_empty(), "{}", trace.text());
}

#[test]
fn lockstep_restart_budget_spent_ends_run() {
    let stack = StackSandbox::new();
    let faults = "fault=[{kind=\"kill\",process=\"planner\",random={count=50,from_s=0.1,to_s=1.0}}]";
    let end = stack.run(&[&BASE[..], &["--log", "run.mcap", "--set", faults, "--set", "supervisor.restart_budget=3"]].concat());
    end.expect(3);
    assert!(end.out.contains("FAULT              planner was lost once more after 3 restarts within 10 s"), "{}", end.out);
    assert!(end.out.contains("detected by: budget"), "{}", end.out);
    let trace = EventTrace::read(&stack.path("run.mcap"));
    assert_eq!(trace.events("restarted", "planner").len(), 3, "{}", trace.text());
    expect_complete(&stack.path("run.mcap"));
    let report = std::fs::read_to_string(stack.path("run.incidents.md")).unwrap();
    assert!(report.contains("planner was lost once more"), "{report}");
}

#[test]
fn rapier_kills_change_no_byte() {
    let stack = StackSandbox::new();
    let softness = "plant.softness={ frequency_hz = 100.0, damping_ratio = 1.0 }";
    let engine = ["--duration", "4", "--set", "plant.engine=rapier", "--set", softness];
    let undisturbed = run(&stack, "undisturbed.mcap", &engine);
    let again = run(&stack, "again.mcap", &engine);
    let faults = "fault=[{kind=\"kill\",process=[\"plant\",\"controller\",\"standby\",\"planner\",\"gate\"],\
                  random={count=15,from_s=0.0,to_s=3.5}},{kind=\"kill\",process=\"plant\",at_s=2.5}]";
    let restart = ["--set", "plant.on_loss=restart", "--set", faults];
    let disturbed = run(&stack, "disturbed.mcap", &[&engine[..], &UNLIMITED_RESTARTS, &restart].concat());
    for topic in ["/state", "/reference"] {
        assert!(undisturbed[topic] == again[topic], "{topic} differs from run to run");
    }
    expect_undisturbed(&disturbed, &undisturbed);
}
