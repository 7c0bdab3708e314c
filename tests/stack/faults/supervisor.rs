//! The supervisor is killed: the launcher starts another, which takes the processes over.

use super::lockstep::expect_undisturbed;
use super::runs::{UNLIMITED_RESTARTS, losses, run, summary};
use super::trace::EventTrace;
use crate::log_file::{expect_complete, streams};
use crate::realtime::realtime_lock;
use crate::running::{self, status_at};
use hapfic_tests::StackSandbox;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::time::Instant;

#[test]
fn lockstep_kills_of_all_but_the_plant_same_torque() {
    let stack = StackSandbox::new();
    let clock = ["--clock", "lockstep", "--duration", "8"];
    let any = "[\"controller\",\"standby\",\"planner\",\"gate\",\"spare_gate\",\"recorder\",\"supervisor\"]";
    // Single ones, and two or three at once.
    let together = ["gate\",\"supervisor", "recorder\",\"supervisor", "supervisor\",\"planner\",\"spare_gate"];
    let at_once = together.iter().enumerate().flat_map(|(index, processes)| {
        let at_s = 1.5 + index as f64;
        processes.split("\",\"").map(move |process| format!("{{kind=\"kill\",process=\"{process}\",at_s={at_s:?}}}"))
    });
    let random = format!("{{kind=\"kill\",process={any},random={{count=70,from_s=0.0,to_s=7.0}}}}");
    let faults = format!("fault=[{random},{}]", at_once.collect::<Vec<_>>().join(","));
    for scenario in ["box", "arm-press"] {
        run(&stack, scenario, "undisturbed.mcap", &clock).expect(0);
        let more = [&clock[..], &UNLIMITED_RESTARTS, &["--set", &faults]].concat();
        run(&stack, scenario, "disturbed.mcap", &more).expect(0);
        let summary = summary(&stack);
        assert_eq!(summary["losses"]["injected"], 77, "{summary}");
        assert!(losses(&summary, "supervisor") >= 8 && losses(&summary, "recorder") >= 5, "{summary}");
        assert_eq!(summary["recorder"]["lost"], 0, "{scenario}: {summary}");
        expect_undisturbed(&streams(&stack.path("disturbed.mcap")), &streams(&stack.path("undisturbed.mcap")));
    }
}

#[test]
fn realtime_supervisor_killed_and_halted_nothing_else_is_lost() {
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
    let faults = "fault=[{kind=\"kill\",process=\"supervisor\",random={count=3,from_s=0.5,to_s=2.5}},\
                  {kind=\"stop\",process=\"supervisor\",at_s=3.0,for_ms=1500},{kind=\"kill\",process=\"planner\",at_s=5.0}]";
    run(&stack, "floor", "run.mcap", &["--duration", "6", "--set", faults]).expect(0);
    let summary = summary(&stack);
    let lost: Vec<u64> = ["supervisor", "planner", "plant", "gate", "spare_gate", "controller", "standby", "recorder"]
        .iter()
        .map(|process| losses(&summary, process))
        .collect();
    assert_eq!(lost, [3, 1, 0, 0, 0, 0, 0, 0], "{summary}");
    assert_eq!((&summary["losses"]["injected"], &summary["recorder"]["lost"]), (&Value::from(5), &Value::from(0)), "{summary}");
    assert!(summary["timing"]["supervisor_delay_ms"].as_f64().unwrap() > 1000.0, "{summary}");
    expect_complete(&stack.path("run.mcap"));
    let trace = EventTrace::read(&stack.path("run.mcap"));
    let taken = trace.events.iter().filter(|e| e.text.contains("its successor takes over")).count();
    assert_eq!(taken, 3, "{}", trace.text());
}

#[test]
fn operator_goes_on_with_successor() {
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
    let mut run = running::start(&stack, "steady", "realtime");
    status_at(&stack, 200);
    stack.run(&["set", "desired_force.z=40"]).expect(0);
    for number in 1..=3 {
        let supervisor = run.supervisor();
        kill_process(Pid::from_raw(supervisor as i32).unwrap(), Signal::KILL).unwrap();
        let begun = Instant::now();
        while run.supervisor() == supervisor || stack.run(&["status", "--json"]).code != Some(0) {
            assert!(begun.elapsed() < running::TIMEOUT, "no successor answers");
        }
        // On the sets of the run, not of its start.
        let force = format!("desired_force.z={}", 40 + number);
        let set = stack.run(&["set", &force]);
        assert_eq!(set.code, Some(0), "{}\n{}", set.out, set.err);
        let change = format!("desired_force_n: [0, 0, {}] -> [0, 0, {}]", 39 + number, 40 + number);
        assert!(set.out.contains(&change) && set.out.contains(&format!("parameters {} in force", 2 + number)), "{}", set.out);
    }
    let stop = stack.run(&["stop"]);
    assert_eq!(stop.code, Some(0), "{}\n{}", stop.out, stop.err);
    let end = run.finish();
    end.expect(3);
    assert!(end.out.contains("supervisor 3 times"), "{}", end.out);
    let trace = EventTrace::read(&stack.path("steady.mcap"));
    assert!(trace.commands.iter().all(|command| command.mode == "active"), "{}", trace.text());
}

#[test]
fn supervisor_lost_too_often_ends_run_in_order() {
    let stack = StackSandbox::new();
    let faults = "fault=[{kind=\"kill\",process=\"supervisor\",random={count=9,from_s=0.1,to_s=5.0}}]";
    let budget = ["--clock", "lockstep", "--duration", "3600", "--set", "supervisor.restart_budget=2", "--set", faults];
    let end = run(&stack, "floor", "run.mcap", &budget);
    end.expect(3);
    assert!(end.err.contains("the supervisor was ended by SIGKILL once more after 2 restarts: the run ends"), "{}", end.err);
    assert!(end.err.contains("its log is run.mcap"), "{}", end.err);
    assert!(expect_complete(&stack.path("run.mcap")) > 100);
    let trace = EventTrace::read(&stack.path("run.mcap"));
    assert!(trace.events.iter().any(|e| e.text.contains("-> stopped")), "{}", trace.text());
    assert_eq!(stack.registrations(), 0);
}
