//! The recorder is killed or halted, or has no log to write: control goes on, and what is missing is counted.

use super::lockstep::expect_undisturbed;
use super::runs::{UNLIMITED_RESTARTS, losses, run, summary};
use crate::log_file::{Streams, streams};
use crate::realtime::realtime_lock;
use hapfic_tests::StackSandbox;
use prost::Message;
use serde_json::Value;

/// Events that are not about a fault and what follows from it.
fn plain_events(streams: &Streams) -> Vec<Vec<u8>> {
    let plain = |(_, bytes): &&(u64, Vec<u8>)| {
        let event = hapfic_log::proto::Event::decode(&bytes[..]).unwrap();
        !["injected", "lost", "restarted", "joined"].contains(&event.kind.as_str())
    };
    streams["/event"].iter().filter(plain).map(|(_, bytes)| bytes.clone()).collect()
}

#[test]
fn lockstep_recorder_kills_lose_nothing() {
    let stack = StackSandbox::new();
    let clock = ["--clock", "lockstep", "--duration", "6"];
    run(&stack, "floor", "undisturbed.mcap", &clock).expect(0);
    let faults = "fault=[{kind=\"kill\",process=\"recorder\",random={count=20,from_s=0.0,to_s=5.5}}]";
    run(&stack, "floor", "disturbed.mcap", &[&clock[..], &UNLIMITED_RESTARTS, &["--set", faults]].concat()).expect(0);
    let summary = summary(&stack);
    assert_eq!((losses(&summary, "recorder"), &summary["recorder"]["lost"]), (20, &Value::from(0)), "{summary}");
    let parts = summary["recorder"]["parts"].as_u64().unwrap();
    assert!(parts > 1 && parts as usize == hapfic_log::parts(&stack.path("disturbed.mcap")).len(), "{parts} parts");
    let [disturbed, undisturbed] = ["disturbed.mcap", "undisturbed.mcap"].map(|log| streams(&stack.path(log)));
    for topic in ["/state", "/reference", "/request", "/request/standby", "/command"] {
        assert!(disturbed[topic] == undisturbed[topic], "{topic} differs");
    }
    assert_eq!(plain_events(&disturbed), plain_events(&undisturbed));
    // Whole parts: nothing is left to recover.
    let end = stack.run(&["recover", "disturbed.mcap"]);
    assert_eq!((end.code, end.out.matches(": whole, no copy was made").count()), (Some(0), parts as usize), "{}", end.out);
}

#[test]
fn lockstep_recorder_and_others_kills_same_torque() {
    let stack = StackSandbox::new();
    let clock = ["--clock", "lockstep", "--duration", "8"];
    run(&stack, "floor", "undisturbed.mcap", &clock).expect(0);
    let faults = "fault=[{kind=\"kill\",process=\"recorder\",at_s=1.0},{kind=\"kill\",process=\"controllers\",at_s=1.0},\
                  {kind=\"kill\",process=\"planner\",at_s=1.0},{kind=\"kill\",process=\"plant\",at_s=1.0},\
                  {kind=\"kill\",process=[\"recorder\",\"controller\",\"standby\",\"planner\",\"plant\"],\
                  random={count=40,from_s=0.0,to_s=6.0}}]";
    let more = ["--set", "plant.on_loss=restart", "--set", faults];
    run(&stack, "floor", "disturbed.mcap", &[&clock[..], &UNLIMITED_RESTARTS, &more].concat()).expect(0);
    assert_eq!(summary(&stack)["recorder"]["lost"], 0);
    expect_undisturbed(&streams(&stack.path("disturbed.mcap")), &streams(&stack.path("undisturbed.mcap")));
}

#[test]
fn realtime_recorder_killed_and_halted_control_goes_on() {
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
    let faults =
        "fault=[{kind=\"kill\",process=\"recorder\",at_s=1.0},{kind=\"stop\",process=\"recorder\",at_s=2.0,for_ms=600000}]";
    run(&stack, "floor", "run.mcap", &["--duration", "5", "--set", faults]).expect(0);
    let summary = summary(&stack);
    assert_eq!(losses(&summary, "recorder"), 2, "{summary}");
    for process in ["plant", "planner", "controller", "standby"] {
        assert_eq!(losses(&summary, process), 0, "{process}: {summary}");
    }
    assert_eq!(summary["timing"]["allocations"], 0);
    let log = streams(&stack.path("run.mcap"));
    let tick = |(_, bytes): &(u64, Vec<u8>)| hapfic_log::proto::State::decode(&bytes[..]).unwrap().tick;
    let ticks: Vec<i64> = log["/state"].iter().map(tick).collect();
    assert!(ticks.is_sorted_by(|a, b| a < b), "a tick is logged twice");
    assert_eq!(ticks.last(), Some(&4999));
    let written = log["/state"].len().min(log["/command"].len()) as u64;
    assert_eq!(summary["recorder"]["lost"], 5000 - written, "{summary}");
    assert_eq!(summary["recorder"]["parts"], 3);
}

#[test]
fn recorder_lost_too_often_ends_run_or_goes_on_without_log() {
    let stack = StackSandbox::new();
    let faults = "fault=[{kind=\"kill\",process=\"recorder\",random={count=9,from_s=0.1,to_s=1.0}}]";
    let more = ["--clock", "lockstep", "--duration", "3", "--set", "supervisor.restart_budget=2", "--set", faults];
    let end = run(&stack, "floor", "run.mcap", &more);
    end.expect(3);
    assert!(
        end.err.contains("recorder was lost once more after 2 restarts") || end.out.contains("after 2 restarts"),
        "{}",
        end.out
    );
    let end = run(&stack, "floor", "run.mcap", &[&more[..], &["--set", "recorder.on_failure=continue"]].concat());
    end.expect(0);
    assert!(end.err.contains("the run goes on without a log"), "{}", end.err);
    let summary = summary(&stack);
    assert!(summary["recorder"]["problem"].as_str().unwrap().contains("ended early"), "{summary}");
    assert!(summary["recorder"]["lost"].as_u64().unwrap() > 0, "{summary}");
}

#[test]
fn recorder_has_no_real_time_privileges() {
    let stack = StackSandbox::new();
    let mut program = stack.start(&["run", "floor", "--duration", "600", "--log", "run.mcap"]);
    program.wait_for(&stack.path("run.mcap"), 100_000);
    let children = program.children(&["recorder"]);
    let recorder = children.iter().find(|(name, _)| name == "recorder").unwrap().1;
    let limits = std::fs::read_to_string(format!("/proc/{recorder}/limits")).unwrap();
    for limit in ["Max realtime priority", "Max locked memory"] {
        let line = limits.lines().find(|line| line.starts_with(limit)).unwrap();
        assert_eq!(line[limit.len()..].split_whitespace().next(), Some("0"), "{line}");
    }
    let status = std::fs::read_to_string(format!("/proc/{recorder}/status")).unwrap();
    let value = |key: &str| status.lines().find_map(|line| line.strip_prefix(key)).unwrap().trim().to_owned();
    let capabilities = u64::from_str_radix(&value("CapEff:"), 16).unwrap();
    // CAP_IPC_LOCK, CAP_SYS_NICE, CAP_SYS_RESOURCE.
    assert_eq!(capabilities & (1 << 14 | 1 << 23 | 1 << 24), 0, "{capabilities:x}");
    assert_eq!(value("VmLck:"), "0 kB");
    let stat = std::fs::read_to_string(format!("/proc/{recorder}/stat")).unwrap();
    // Field 41 of stat(5), counted behind the name: SCHED_OTHER.
    assert_eq!(stat.rsplit_once(") ").unwrap().1.split_whitespace().nth(38), Some("0"), "{stat}");
    program.signal(rustix::process::Signal::INT);
    let _ = program.finish();
}
