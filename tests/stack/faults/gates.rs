//! The gates are killed and halted: the other one continues from the last command.

use super::lockstep::expect_undisturbed;
use super::runs::UNLIMITED_RESTARTS;
use super::trace::EventTrace;
use crate::log_file::{expect_complete, streams};
use crate::realtime::realtime_lock;
use hapfic_tests::StackSandbox;

const LOCKSTEP: [&str; 6] = ["run", "floor", "--clock", "lockstep", "--duration", "8"];

#[test]
fn lockstep_gate_kills_same_bytes() {
    let stack = StackSandbox::new();
    stack.run(&[&LOCKSTEP[..], &["--log", "undisturbed.mcap"]].concat()).expect(0);
    // One gate or the other, and now and then both at once.
    let faults = "fault=[{kind=\"kill\",process=[\"gate\",\"spare_gate\"],random={count=40,from_s=0.0,to_s=6.0}},\
                  {kind=\"kill\",process=\"gate\",at_s=2.0},{kind=\"kill\",process=\"spare_gate\",at_s=2.0},\
                  {kind=\"kill\",process=\"gate\",at_s=0.199},{kind=\"kill\",process=\"gate\",at_s=1.599}]";
    stack.run(&[&LOCKSTEP[..], &UNLIMITED_RESTARTS, &["--log", "disturbed.mcap", "--set", faults]].concat()).expect(0);
    expect_complete(&stack.path("disturbed.mcap"));
    let [disturbed, undisturbed] = ["disturbed.mcap", "undisturbed.mcap"].map(|log| streams(&stack.path(log)));
    for topic in ["/state", "/reference", "/request", "/request/standby", "/command", "/operator"] {
        assert!(disturbed[topic] == undisturbed[topic], "{topic} differs");
    }
    let trace = EventTrace::read(&stack.path("disturbed.mcap"));
    let lost = ["gate", "spare_gate"].map(|gate| trace.events("lost", gate).len());
    assert!(lost[0] > 5 && lost[1] > 5, "{lost:?}:\n{}", trace.text());
}

#[test]
fn lockstep_any_process_kills_same_torque() {
    let stack = StackSandbox::new();
    stack.run(&[&LOCKSTEP[..], &["--log", "undisturbed.mcap"]].concat()).expect(0);
    let at = |process: &str| format!("{{kind=\"kill\",process=\"{process}\",at_s=2.0}}");
    let all = ["gate", "spare_gate", "recorder", "controllers", "planner", "plant"].map(at).join(",");
    let faults = format!(
        "fault=[{all},{{kind=\"kill\",process=[\"gate\",\"spare_gate\",\"recorder\",\"controller\",\"standby\",\"planner\",\
         \"plant\"],random={{count=60,from_s=0.0,to_s=6.0}}}}]"
    );
    let more = ["--log", "disturbed.mcap", "--set", "plant.on_loss=restart", "--set", &faults];
    stack.run(&[&LOCKSTEP[..], &UNLIMITED_RESTARTS, &more].concat()).expect(0);
    expect_undisturbed(&streams(&stack.path("disturbed.mcap")), &streams(&stack.path("undisturbed.mcap")));
}

/// Every tick has a command, whichever gate is killed or halted, and no process but that is lost.
#[test]
fn realtime_gate_kills_and_halts_other_gate_answers() {
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
    let kill = |gate: &str, at: &str| format!("{{kind=\"kill\",process=\"{gate}\",at_s={at}}}");
    let kills = [("gate", "0.7"), ("spare_gate", "1.2"), ("gate", "1.7"), ("gate", "2.2"), ("spare_gate", "2.7")];
    let kills = kills.map(|(gate, at)| kill(gate, at)).join(",");
    let faults = format!("fault=[{kills},{{kind=\"stop\",process=\"gate\",at_s=3.2,for_ms=300}}]");
    stack.run(&["run", "floor", "--duration", "5", "--log", "run.mcap", "--set", &faults]).expect(0);
    assert_eq!(expect_complete(&stack.path("run.mcap")), 5000);
    let trace = EventTrace::read(&stack.path("run.mcap"));
    assert_eq!(["gate", "spare_gate"].map(|gate| trace.events("lost", gate).len()), [3, 2], "{}", trace.text());
    for process in ["plant", "planner", "controller", "standby", "recorder"] {
        assert!(trace.events("lost", process).is_empty(), "{process}:\n{}", trace.text());
    }
    let fresh = trace.commands.iter().filter(|command| command.source == "fresh").count();
    assert!(fresh > 4500, "{fresh} of 5000 ticks have the command of a request of the same tick:\n{}", trace.text());
    let last = trace.commands.last().unwrap();
    assert_eq!((last.source.as_str(), last.mode.as_str()), ("fresh", "active"));
}

/// A change of the operator outlives the gate that has placed it.
#[test]
fn placed_change_outlives_its_gate() {
    let stack = StackSandbox::new();
    // Both gates are killed right after a change, before it is in force: the script changes at every 5 ms around it.
    let script = (0..20).map(|i| format!("{{at_s={},taper={}}}", 0.5 + 0.005 * f64::from(i), 0.2 + 0.01 * f64::from(i)));
    let operator = format!("operator=[{}]", script.collect::<Vec<_>>().join(","));
    let run = |log: &str, faults: &str| {
        let words = ["--log", log, "--set", &operator, "--set", faults];
        stack.run(&[&LOCKSTEP[..4], &["--duration", "2"], &UNLIMITED_RESTARTS, &words].concat()).expect(0);
        streams(&stack.path(log))
    };
    let undisturbed = run("undisturbed.mcap", "fault=[]");
    let faults = "fault=[{kind=\"kill\",process=[\"gate\",\"spare_gate\"],random={count=12,from_s=0.49,to_s=0.61}}]";
    let disturbed = run("disturbed.mcap", faults);
    for topic in ["/state", "/command", "/operator"] {
        assert!(disturbed[topic] == undisturbed[topic], "{topic} differs");
    }
}
