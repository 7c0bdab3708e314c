//! Realtime: properties that hold at any timing of the machine.

use crate::log_file::expect_complete;
use crate::running;
use hapfic_ipc::{clock, realtime};
use hapfic_log::Record;
use hapfic_tests::StackSandbox;
use rustix::fs::{FlockOperation, flock};
use std::collections::BTreeMap;

/// Takes the lock for the only realtime run; its file is beside the tested binary.
pub fn realtime_lock() -> std::fs::File {
    let path = hapfic_tests::hapfic().with_file_name("realtime-tests.lock");
    let file = std::fs::OpenOptions::new().create(true).truncate(false).write(true).open(path).unwrap();
    flock(&file, FlockOperation::LockExclusive).unwrap();
    file
}

#[test]
fn realtime_run_complete_within_bounds() {
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
    stack.run(&["run", "floor", "--duration", "4", "--log", "run.mcap", "--summary-json", "summary.json"]).expect(0);
    assert_eq!(expect_complete(&stack.path("run.mcap")), 4000);
    let text = std::fs::read_to_string(stack.path("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(summary["completed"], true);
    assert_eq!(summary["recorder"]["lost"], 0);
    assert_eq!(summary["timing"]["allocations"], 0, "real-time code must not allocate");
    let bound = [0, 1, 2].map(|axis| summary["tracking"]["bound_m"][axis].as_f64().unwrap());
    expect_law(&stack.path("run.mcap"), bound);
}

/// Ticks after a missed tick in which the bound of the tracking error does not apply.
const RECOVERY_TICKS: i64 = 500;

/// Asserts properties of the law on every tick of a log, whatever the machine has missed.
///
/// The error of every fresh command is e = x_d + dx - x (Algorithm 2), from the logged state and reference of its tick or
/// from a held reference. The tracking error stays within `bound` [m] except shortly after a missed tick.
fn expect_law(log: &std::path::Path, bound: [f64; 3]) {
    let (mut states, mut references, mut commands) = (BTreeMap::new(), BTreeMap::new(), Vec::new());
    for message in hapfic_log::Reader::open(log).unwrap() {
        match message.unwrap().record {
            Record::State(state) => drop(states.insert(state.tick, state.foot_position)),
            Record::Reference(reference) => drop(references.insert(reference.tick, reference.position)),
            Record::Command(command) => commands.push(command),
            _ => {}
        }
    }
    let (mut fresh, mut tracked, mut last_miss) = (0, 0, -RECOVERY_TICKS);
    for command in &commands {
        let tick = command.tick;
        if command.source != "fresh" {
            last_miss = tick;
            continue;
        }
        let foot = &states[&tick];
        // Until a controller has the first reference, it holds the foot where it is.
        let held = (tick < 3).then_some(foot);
        let mut recent = references.range(tick - 3..=tick).rev().map(|(_, position)| position).chain(held);
        assert!(
            recent.any(|x_d| (0..3).all(|i| (command.error[i] - (x_d[i] + command.offset[i] - foot[i])).abs() < 1e-12)),
            "tick {tick}: e = {:?} is not x_d + dx - x with x = {foot:?} and a recent reference",
            command.error
        );
        fresh += 1;
        if let Some(x_d) = references.get(&tick).filter(|_| tick - last_miss > RECOVERY_TICKS) {
            for axis in 0..3 {
                let error = (foot[axis] - x_d[axis]).abs();
                assert!(
                    error <= bound[axis],
                    "tick {tick}, axis {axis}: |x - x_d| = {error} m, expected at most {} m",
                    bound[axis]
                );
            }
            tracked += 1;
        }
    }
    assert!(fresh >= commands.len() / 2 && tracked > 0, "{fresh} fresh commands of {}, {tracked} ticks tracked", commands.len());
}

#[test]
fn realtime_off_run_complete() {
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
    stack.run(&["run", "floor", "--duration", "0.5", "--realtime", "off", "--log", "run.mcap"]).expect(0);
    assert_eq!(expect_complete(&stack.path("run.mcap")), 500);
}

/// Core of a pinned thread; `None` if the thread does not exist or is not pinned.
fn core_of(pid: u32, name: &str) -> Option<usize> {
    let tasks = std::fs::read_dir(format!("/proc/{pid}/task")).unwrap().flatten();
    let status = tasks.filter_map(|task| std::fs::read_to_string(task.path().join("status")).ok());
    let field = |status: &str, field: &str| status.lines().find_map(|l| l.strip_prefix(field)).map(|l| l.trim().to_owned());
    let thread = { status }.find(|status| field(status, "Name:").is_some_and(|found| found == name))?;
    field(&thread, "Cpus_allowed_list:")?.parse().ok()
}

/// Simulates steal time: a thread of higher priority occupies the gate's core for five ticks, again and again.
#[test]
fn gate_core_taken_spare_gate_answers() {
    const REPETITIONS: u32 = 20;
    const STEAL_NS: u64 = 5_000_000;
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
    std::fs::write(stack.path("steady.toml"), running::unscripted(&stack)).unwrap();
    let mut run =
        stack.start(&["run", "steady.toml", "--duration", "3600", "--log", "run.mcap", "--summary-json", "summary.json"]);
    let _ = running::status_at(&stack, 500);
    let children = run.children(&["gate", "spare_gate"]);
    let pid = |process| children.iter().find(|(name, _)| name == process).unwrap().1;
    let cores = [("gate", "hapfic-gate"), ("spare_gate", "hapfic-gate-2")].map(|(process, thread)| core_of(pid(process), thread));
    // Without privileges, or with one core, both gates sleep on the shared core.
    let has_spare = realtime::may_fifo(80) && realtime::usable_cores().len() >= 2;
    if has_spare {
        assert_ne!(cores[0], cores[1]);
        let hog = std::thread::spawn(move || {
            realtime::pin(None, cores[0].unwrap()).unwrap();
            realtime::set_fifo(80).unwrap();
            for _ in 0..REPETITIONS {
                let end = clock::now_ns() + STEAL_NS;
                while clock::now_ns() < end {
                    std::hint::spin_loop();
                }
                clock::sleep_until(end + 4 * STEAL_NS);
            }
        });
        hog.join().unwrap();
    }
    run.signal(rustix::process::Signal::INT);
    run.finish().expect_nothing_left();
    let summary: serde_json::Value = serde_json::from_slice(&std::fs::read(stack.path("summary.json")).unwrap()).unwrap();
    let spare_ticks = summary["timing"]["spare_gate_ticks"].as_u64().unwrap();
    let expected = if has_spare { REPETITIONS } else { 0 };
    assert!(
        spare_ticks >= expected.into(),
        "found {spare_ticks} spare ticks, expected at least one in each of {expected} repetitions"
    );
    assert_eq!(summary["recorder"]["lost"], 0);
    assert_eq!(summary["timing"]["allocations"], 0);
}
