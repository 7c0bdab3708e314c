//! The watcher has no faults of its own: late observers, halted supervisors and frozen processes lose nothing healthy.

use crate::faults::runs::summary;
use crate::realtime::realtime_lock;
use crate::running;
use hapfic_ipc::{Bus, Domain, topic::view};
use hapfic_tests::{StackSandbox, StartedProgram};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::io::Read;
use std::time::{Duration, Instant};

/// Asserts that a completed run has lost no process.
fn expect_no_losses(stack: &StackSandbox) -> Value {
    let summary = summary(stack);
    assert_eq!(summary["losses"]["processes"], Value::Array(Vec::new()), "found lost processes, expected none");
    assert_eq!(summary["faults"], Value::Array(Vec::new()));
    assert_eq!(summary["timing"]["allocations"], 0);
    summary
}

const RUN: [&str; 6] = ["run", "floor", "--summary-json", "summary.json", "--duration", "6"];

#[test]
fn recorder_stalled_run_goes_on() {
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
    let pipe = stack.path("pipe");
    rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR).unwrap();
    let run = stack.start(&[&RUN[..], &["--log", "pipe"]].concat());
    let reader = std::thread::spawn(move || {
        let mut log = std::fs::File::open(pipe).unwrap();
        let mut start = vec![0; 400_000];
        log.read_exact(&mut start).unwrap();
        // The writer is blocked for longer than any time-out of a detector.
        std::thread::sleep(Duration::from_secs(3));
        std::io::copy(&mut log, &mut std::io::sink()).unwrap()
    });
    let end = run.finish();
    reader.join().unwrap();
    assert_eq!(end.code, Some(0), "{}\n{}", end.out, end.err);
    expect_no_losses(&stack);
}

#[test]
fn supervisor_halted_nothing_healthy_is_killed() {
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
    let mut run = stack.start(&[&RUN[..], &["--log", "run.mcap"]].concat());
    run.wait_for(&stack.path("run.mcap"), 200_000);
    let supervisor = Pid::from_raw(run.supervisor() as i32).unwrap();
    kill_process(supervisor, Signal::STOP).unwrap();
    std::thread::sleep(Duration::from_secs(2));
    kill_process(supervisor, Signal::CONT).unwrap();
    // Ctrl-Z halts the launcher: nothing depends on it.
    run.signal(Signal::STOP);
    std::thread::sleep(Duration::from_secs(1));
    run.signal(Signal::CONT);
    let end = run.finish();
    end.expect(0);
    let summary = expect_no_losses(&stack);
    assert!(summary["timing"]["supervisor_delay_ms"].as_f64().unwrap() > 1000.0);
    assert!(end.out.contains("supervisor         was itself delayed"), "{}", end.out);
    let braked = summary["timing"]["brake_ticks"].as_u64().unwrap();
    assert!(braked < 1000, "{braked} of 2000 ticks braked: the gate goes on without its supervisor");
}

/// Group of the freezer, thawed and removed when dropped.
struct Freezer(std::path::PathBuf);

impl Freezer {
    /// Freezes a process; `None` if this user may not.
    fn freeze(pid: u32) -> Option<Self> {
        let folder = std::path::PathBuf::from(format!("/sys/fs/cgroup/freezer/hapfic-test-{}", std::process::id()));
        std::fs::create_dir(&folder).ok()?;
        let freezer = Self(folder);
        std::fs::write(freezer.0.join("cgroup.procs"), pid.to_string()).ok()?;
        std::fs::write(freezer.0.join("freezer.state"), "FROZEN").ok()?;
        Some(freezer)
    }
}

impl Drop for Freezer {
    fn drop(&mut self) {
        let _ = std::fs::write(self.0.join("freezer.state"), "THAWED");
        let begun = Instant::now();
        while std::fs::remove_dir(&self.0).is_err() && begun.elapsed() < Duration::from_secs(5) {
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

fn pid_of(run: &mut StartedProgram, name: &str) -> u32 {
    run.children(&[name]).into_iter().find(|(child, _)| child == name).unwrap().1
}

#[test]
fn frozen_process_is_abandoned_and_replaced() {
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
    let mut run = running::start(&stack, "steady", "realtime");
    let _ = running::status_at(&stack, 500);
    let standby = pid_of(&mut run, "standby");
    let Some(freezer) = Freezer::freeze(standby) else {
        eprintln!("skipped: this user may not freeze a process");
        return;
    };
    let controller = pid_of(&mut run, "controller");
    kill_process(Pid::from_raw(controller as i32).unwrap(), Signal::KILL).unwrap();
    let begun = Instant::now();
    loop {
        let children = hapfic_tests::children_of(run.pid());
        let replaced = |name: &str, old: u32| children.iter().any(|(child, pid)| child == name && *pid != old);
        if replaced("standby", standby) && replaced("controller", controller) {
            break;
        }
        assert!(begun.elapsed() < running::TIMEOUT, "not replaced: {children:?}");
    }
    let tick = running::status_at(&stack, 0)["tick"].as_i64().unwrap();
    let status = running::status_at(&stack, tick + 500);
    assert_eq!(status["severity"], "nominal", "{status}");
    drop(freezer);
    run.signal(Signal::INT);
    run.finish().expect_nothing_left();
}

#[test]
fn observers_of_views_cost_no_allocation() {
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
    let run = stack.start(&[&RUN[..], &["--log", "run.mcap"]].concat());
    let status = running::status_at(&stack, 500);
    let name = status["run"].as_str().unwrap();
    let domain = Domain::new(&format!("{name}_"), &format!("/dev/shm/{name}")).unwrap();
    for _ in 0..20 {
        let bus = Bus::open(&domain, "observer").unwrap();
        let mut states = bus.view_input(&view::STATE).unwrap();
        let mut commands = bus.view_input(&view::COMMAND).unwrap();
        let (mut ticks, mut answered) = (0, 0);
        let begun = Instant::now();
        while (ticks < 20 || answered < 20) && begun.elapsed() < running::TIMEOUT {
            while let Some(state) = states.next().unwrap() {
                ticks += i32::from(state.tick >= 0);
            }
            while commands.next().unwrap().is_some() {
                answered += 1;
            }
        }
        assert!(ticks >= 20 && answered >= 20, "{ticks} states, {answered} commands");
    }
    run.finish().expect(0);
    expect_no_losses(&stack);
}

#[test]
fn dead_process_and_stop_are_reported() {
    let stack = StackSandbox::new();
    let _lock = realtime_lock();
    std::fs::write(stack.path("steady.toml"), running::unscripted(&stack)).unwrap();
    let mut run = stack.start(&[
        "run",
        "steady.toml",
        "--realtime",
        "off",
        "--duration",
        "3600",
        "--log",
        "run.mcap",
        "--set",
        "supervisor.restart_budget=0",
        "--summary-json",
        "summary.json",
    ]);
    let _ = running::status_at(&stack, 200);
    let planner = pid_of(&mut run, "planner");
    kill_process(Pid::from_raw(planner as i32).unwrap(), Signal::KILL).unwrap();
    let begun = Instant::now();
    let status = loop {
        let status = running::status_at(&stack, 0);
        if status["severity"] == "stopped" {
            break status;
        }
        assert!(begun.elapsed() < running::TIMEOUT, "{status}");
    };
    assert_eq!(status["stopped_by"], "budget", "{status}");
    let phase = |name: &str| {
        status["processes"].as_array().unwrap().iter().find(|process| process["name"] == name).unwrap()["phase"].clone()
    };
    assert_eq!((phase("planner"), phase("plant")), ("lost".into(), "running".into()), "{status}");
    run.signal(Signal::INT);
    let end = run.finish();
    assert!(end.out.contains("NOT RECOVERED"), "{}", end.out);
    assert_eq!(summary(&stack)["losses"]["processes"][0]["recovered"], false);
}

#[test]
fn interrupted_run_is_no_fault_and_deleted_log_is_reported() {
    let stack = StackSandbox::new();
    let mut run = stack.start(&["run", "floor", "--clock", "lockstep", "--duration", "3600", "--log", "run.mcap"]);
    run.wait_for(&stack.path("run.mcap"), 200_000);
    std::fs::remove_file(stack.path("run.mcap")).unwrap();
    run.signal(Signal::INT);
    let end = run.finish();
    end.expect(3);
    assert!(
        !end.out.contains("FAULT") && end.out.contains("ended              supervisor was asked to end by a signal"),
        "{}",
        end.out
    );
    assert!(end.out.contains("was deleted during the run"), "{}", end.out);
}

#[test]
fn rearm_before_requested_stop_is_rejected() {
    let stack = StackSandbox::new();
    let patient = ["--set", "supervisor.heartbeat_timeout_ms=10000", "--set", "supervisor.stall_timeout_ms=60000"];
    let run = ["run", "floor", "--clock", "lockstep", "--duration", "3600", "--log", "run.mcap"];
    let mut run = stack.start(&[&run[..], &patient[..]].concat());
    let _ = running::status_at(&stack, 200);
    let plant = Pid::from_raw(pid_of(&mut run, "plant") as i32).unwrap();
    // Without a plant no tick is done, so the stop stays pending.
    kill_process(plant, Signal::STOP).unwrap();
    let stop = stack.run(&["estop"]);
    assert!(stop.out.contains("latched stop requested: no tick has been done since"), "{}\n{}", stop.out, stop.err);
    let rearm = stack.run(&["rearm"]);
    rearm.expect(2);
    assert!(rearm.err.contains("the latched stop takes effect with the next tick"), "{}", rearm.err);
    kill_process(plant, Signal::CONT).unwrap();
    let begun = Instant::now();
    while running::status_at(&stack, 0)["stopped_by"] != "operator" {
        assert!(begun.elapsed() < running::TIMEOUT);
    }
    stack.run(&["rearm"]).expect(0);
    run.signal(Signal::INT);
    run.finish().expect_nothing_left();
}

/// Kills in [`replacements_killed_while_starting_never_hang`]; `HAPFIC_KILLS` sets another number.
const KILLS: u32 = 60;

/// Kills every replacement 0 to 30 ms after it has appeared: while it maps, creates and connects its segments.
#[test]
fn replacements_killed_while_starting_never_hang() {
    let kills: u32 = std::env::var("HAPFIC_KILLS").map_or(KILLS, |number| number.parse().unwrap());
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
    std::fs::write(stack.path("steady.toml"), running::unscripted(&stack)).unwrap();
    let budget = ["--set", "supervisor.restart_budget=1000000", "--set", "supervisor.restart_backoff_ms=1"];
    let mut run = stack.start(&[&["run", "steady.toml", "--duration", "36000", "--log", "run.mcap"], &budget[..]].concat());
    let _ = running::status_at(&stack, 200);
    let mut killed = std::collections::HashSet::new();
    // SplitMix64 of the number of the kill: the delays are the same in every run.
    let delay_us = |number: u64| {
        let mut z = number.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (z ^ (z >> 27)) % 30_000
    };
    for number in 0..kills {
        let begun = Instant::now();
        let (name, pid) = loop {
            let children = hapfic_tests::children_of(run.pid());
            let new = children.into_iter().find(|(name, pid)| name != "plant" && name != "clean-up" && !killed.contains(pid));
            if let Some(found) = new {
                break found;
            }
            assert!(begun.elapsed() < running::TIMEOUT, "after {number} kills no process is replaced any more");
        };
        killed.insert(pid);
        std::thread::sleep(Duration::from_micros(delay_us(number.into())));
        // A process may have ended by itself.
        let _ = kill_process(Pid::from_raw(pid as i32).unwrap(), Signal::KILL);
        if number % 50 == 49 {
            let tick = running::status_at(&stack, 0)["tick"].as_i64().unwrap();
            let _ = running::status_at(&stack, tick + 20);
            eprintln!("{} kills, the last of {name}", number + 1);
        }
    }
    let tick = running::status_at(&stack, 0)["tick"].as_i64().unwrap();
    let _ = running::status_at(&stack, tick + 1000);
    let _ = run.children(&["plant", "planner", "controller", "standby"]);
    run.signal(Signal::INT);
    run.finish().expect_nothing_left();
}
