//! Every end of a run leaves a whole log, and no remains.

use crate::faults::trace::EventTrace;
use crate::log_file::expect_complete;
use hapfic_tests::{StackSandbox, is_running, remains_of};
use rustix::process::{Pid, Signal, kill_process};
use std::io::Read;
use std::time::{Duration, Instant};

/// Lockstep run of an hour.
const LONG: [&str; 8] = ["run", "floor", "--clock", "lockstep", "--duration", "3600", "--log", "run.mcap"];
const PROCESSES: [&str; 7] = ["plant", "planner", "controller", "standby", "gate", "spare_gate", "recorder"];
/// Size of the log of a run with some hundred ticks [bytes].
const RUNNING_LOG_BYTES: u64 = 200_000;

/// Asserts that processes end by themselves.
fn expect_ended(children: &[(String, u32)]) {
    let start = Instant::now();
    while children.iter().any(|(_, pid)| is_running(*pid)) {
        assert!(start.elapsed() < Duration::from_secs(30), "still running: {children:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn run_signal_ends_in_order() {
    for signal in [Signal::INT, Signal::TERM] {
        let stack = StackSandbox::new();
        let mut run = stack.start(&LONG);
        run.wait_for(&stack.path("run.mcap"), RUNNING_LOG_BYTES);
        run.signal(signal);
        let end = run.finish();
        end.expect(3);
        assert!(end.out.contains("NOT COMPLETED") && end.out.contains("signal"), "{}", end.out);
        assert!(expect_complete(&stack.path("run.mcap")) > 100);
        assert_eq!(stack.registrations(), 0);
    }
}

#[test]
fn plant_kill_ends_run_with_report() {
    let stack = StackSandbox::new();
    let mut run = stack.start(&LONG);
    let children = run.children(&PROCESSES);
    run.wait_for(&stack.path("run.mcap"), RUNNING_LOG_BYTES);
    let (_, pid) = children.iter().find(|(n, _)| n == "plant").unwrap();
    kill_process(Pid::from_raw(*pid as i32).unwrap(), Signal::KILL).unwrap();
    let end = run.finish();
    end.expect(3);
    assert!(end.out.contains("FAULT              plant was ended by SIGKILL"), "{}", end.out);
    assert!(expect_complete(&stack.path("run.mcap")) > 100);
}

#[test]
fn launcher_kill_brakes_and_ends_run_in_order() {
    let stack = StackSandbox::new();
    let mut run = stack.start(&LONG);
    let supervisor = run.supervisor();
    let children = run.children(&PROCESSES);
    run.wait_for(&stack.path("run.mcap"), RUNNING_LOG_BYTES);
    // A halted supervisor wakes.
    kill_process(Pid::from_raw(supervisor as i32).unwrap(), Signal::STOP).unwrap();
    let end = run.kill();
    expect_ended(&children);
    end.expect_nothing_left();
    assert_eq!(stack.registrations(), 0);
    assert!(expect_complete(&stack.path("run.mcap")) > 100);
    let trace = EventTrace::read(&stack.path("run.mcap"));
    assert!(trace.events.iter().any(|e| e.text.contains("nominal -> stopped")), "{:?}", trace.events);
    assert!(trace.events.iter().any(|e| e.text.starts_with("launcher was lost")), "{:?}", trace.events);
}

#[test]
fn second_signal_ends_run_without_its_supervisor() {
    let stack = StackSandbox::new();
    let mut run = stack.start(&[&LONG[..], &["--summary-json", "run.json"]].concat());
    let supervisor = Pid::from_raw(run.supervisor() as i32).unwrap();
    run.wait_for(&stack.path("run.mcap"), RUNNING_LOG_BYTES);
    // It would answer the first one only when it goes on; the launcher wakes it, so it is halted again and again.
    let halted = std::sync::atomic::AtomicBool::new(true);
    let end = std::thread::scope(|scope| {
        scope.spawn(|| {
            while halted.load(std::sync::atomic::Ordering::Relaxed) && kill_process(supervisor, Signal::STOP).is_ok() {
                std::thread::yield_now();
            }
        });
        run.signal(Signal::INT);
        std::thread::sleep(Duration::from_millis(500));
        run.signal(Signal::INT);
        let end = run.finish();
        halted.store(false, std::sync::atomic::Ordering::Relaxed);
        end
    });
    end.expect(3);
    assert!(end.err.contains("the second signal ends the run without its supervisor"), "{}", end.err);
    assert!(expect_complete(&stack.path("run.mcap")) > 100);
    let json = std::fs::read_to_string(stack.path("run.json")).unwrap();
    assert!(json.contains("\"completed\": false"), "{json}");
}

#[test]
fn supervisor_kill_at_the_end_same_result() {
    let stack = StackSandbox::new();
    let clock = ["run", "floor", "--clock", "lockstep", "--duration", "1", "--log", "run.mcap", "--summary-json", "run.json"];
    stack.run(&clock).expect(0);
    let messages = || {
        let summary: serde_json::Value = serde_json::from_slice(&std::fs::read(stack.path("run.json")).unwrap()).unwrap();
        (summary["recorder"]["lost"].as_u64().unwrap(), summary["tracking"].to_string(), summary["completed"].clone())
    };
    let undisturbed = messages();
    // While it ends the run, waits for the recorder, or has left the result: later in each run.
    for delay_us in (0..60_000).step_by(3000) {
        let mut run = stack.start(&clock);
        let supervisor = Pid::from_raw(run.supervisor() as i32).unwrap();
        let gate = run.children(&["gate"]).into_iter().find(|(name, _)| name == "gate").unwrap().1;
        while is_running(gate) {
            std::thread::yield_now();
        }
        std::thread::sleep(Duration::from_micros(delay_us));
        // It may have ended.
        let _ = kill_process(supervisor, Signal::KILL);
        let end = run.finish();
        end.expect(0);
        assert_eq!(messages(), undisturbed, "{delay_us} us after the end of the gate: {}", end.err);
        assert_eq!(expect_complete(&stack.path("run.mcap")), 1000);
    }
}

#[test]
fn nobody_within_grace_time_processes_brake_and_end() {
    let stack = StackSandbox::new();
    // An external program does not know how to end by itself.
    let external = "processes.planner=[\"sh\", \"-c\", \"sleep 1000 & sleep 1000\"]";
    for arguments in [&["--set", "supervisor.grace_ms=500"][..], &["--set", external, "--set", "supervisor.grace_ms=500"]] {
        let _ = std::fs::remove_file(stack.path("run.mcap"));
        let mut run = stack.start(&[&LONG[..], arguments].concat());
        let with_planner = arguments.len() == 2;
        let children = run.children(&["plant", "controller", "standby", "gate", "spare_gate", "recorder"]);
        if with_planner {
            run.wait_for(&stack.path("run.mcap"), RUNNING_LOG_BYTES);
        } else {
            // It never gets ready, so there is no tick; the gates have joined the run by then.
            std::thread::sleep(Duration::from_secs(2));
        }
        // A halted process wakes, and ends too.
        let (_, halted) = children.iter().find(|(name, _)| name == "standby").unwrap();
        kill_process(Pid::from_raw(*halted as i32).unwrap(), Signal::STOP).unwrap();
        let end = run.kill_with_supervisor();
        expect_ended(&children);
        end.expect_nothing_left();
        assert_eq!(stack.registrations(), 0);
        if with_planner {
            assert!(expect_complete(&stack.path("run.mcap")) > 100);
            let trace = EventTrace::read(&stack.path("run.mcap"));
            assert!(trace.events.iter().any(|e| e.text.contains("-> stopped")), "{:?}", trace.events);
        }
    }
}

#[test]
fn all_killed_next_start_cleans_up() {
    let stack = StackSandbox::new();
    let mut run = stack.start(&LONG);
    let children = run.children(&PROCESSES);
    run.wait_for(&stack.path("run.mcap"), RUNNING_LOG_BYTES);
    let end = run.kill_with_supervisor();
    for (_, pid) in &children {
        let _ = kill_process(Pid::from_raw(*pid as i32).unwrap(), Signal::KILL);
    }
    assert_eq!(end.code, None);
    expect_ended(&children);
    assert!(!remains_of(end.launcher).is_empty(), "found no remains of a killed run");
    let next = stack.run(&["run", "floor", "--clock", "lockstep", "--duration", "0.1", "--log", "next.mcap"]);
    next.expect(0);
    assert!(next.err.contains("its log is recovered to") && next.err.contains("run.recovered.mcap"), "{}", next.err);
    assert!(expect_complete(&stack.path("run.recovered.mcap")) > 100);
    end.expect_nothing_left();
    assert_eq!(stack.registrations(), 0);
}

/// Phases of a start, in their order, as they show on the machine.
const START_PHASES: [&str; 7] = ["registered", "segments", "log", "supervisor", "first process", "all processes", "ticks"];

/// Whether a starting run has reached a phase.
fn has_reached(phase: &str, stack: &StackSandbox, launcher: u32) -> bool {
    let log_bytes = || std::fs::metadata(stack.path("run.mcap")).map_or(0, |log| log.len());
    match phase {
        "registered" => stack.registrations() > 0,
        "segments" => remains_of(launcher).iter().any(|name| name.starts_with("/dev/shm")),
        "supervisor" => !hapfic_tests::children_of(launcher).is_empty(),
        "log" => stack.path("run.mcap").exists(),
        "first process" => hapfic_tests::children_of(launcher).len() > 1,
        "all processes" => hapfic_tests::children_of(launcher).len() >= PROCESSES.len(),
        _ => log_bytes() > RUNNING_LOG_BYTES,
    }
}

#[test]
fn kill_in_each_start_phase_no_remains() {
    let stack = StackSandbox::new();
    for (phase, together) in START_PHASES.into_iter().flat_map(|phase| [(phase, true), (phase, false)]) {
        let _ = std::fs::remove_file(stack.path("run.mcap"));
        let run = stack.start(&LONG);
        let begun = Instant::now();
        while !has_reached(phase, &stack, run.pid()) {
            assert!(begun.elapsed() < Duration::from_secs(60), "the start does not reach the phase '{phase}'");
        }
        let children = hapfic_tests::children_of(run.pid());
        // Launcher and supervisor together, then the launcher alone.
        let end = if together { run.kill_with_supervisor() } else { run.kill() };
        assert_eq!(end.code, None, "phase '{phase}': the run had ended before");
        expect_ended(&children);
        stack.run(&["run", "floor", "--clock", "lockstep", "--duration", "0.05", "--log", "next.mcap"]).expect(0);
        end.expect_nothing_left();
        assert_eq!(stack.registrations(), 0, "phase '{phase}'");
    }
}

#[test]
fn external_process_run_end_children_end() {
    let stack = StackSandbox::new();
    let external = "processes.planner=[\"sh\", \"-c\", \"sleep 1000 & sleep 1000\"]";
    // The supervisor ends it, also without the launcher.
    for signal in [Signal::INT, Signal::KILL] {
        let arguments = [&LONG[..], &["--set", external]].concat();
        let run = stack.start(&arguments);
        let begun = Instant::now();
        // The plant, both controllers, the shell and its two children.
        while remains_of(run.pid()).iter().filter(|r| r.starts_with("process")).count() < 6 {
            assert!(begun.elapsed() < Duration::from_secs(30), "{:?}", remains_of(run.pid()));
            std::thread::yield_now();
        }
        let end = if signal == Signal::KILL {
            run.kill()
        } else {
            run.signal(signal);
            run.finish()
        };
        if signal != Signal::KILL {
            assert_eq!(end.code, Some(3), "{}", end.err);
        }
        end.expect_nothing_left();
    }
}

#[test]
fn log_write_failure_ends_run() {
    let stack = StackSandbox::new();
    let pipe = stack.path("pipe");
    rustix::fs::mkfifoat(rustix::fs::CWD, &pipe, rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR).unwrap();
    let run = stack.start(&["run", "floor", "--clock", "lockstep", "--duration", "3600", "--log", "pipe"]);
    let mut reader = std::fs::File::open(&pipe).unwrap();
    // The reader closes the pipe after these bytes, as a full disk would.
    let mut bytes = vec![0; 100_000];
    reader.read_exact(&mut bytes).unwrap();
    drop(reader);
    let end = run.finish();
    end.expect(3);
    assert!(end.out.contains("FAULT              recorder"), "{}", end.out);
    assert!(end.out.contains("cannot write the log"), "{}", end.out);
}
