//! Realtime: properties that hold at any timing of the machine.

use crate::log_file::expect_complete;
use crate::running;
use hapfic_ipc::{clock, realtime};
use hapfic_tests::Stack;
use rustix::fs::{FlockOperation, flock};

/// Takes the lock for the only realtime run; its file is beside the tested binary.
pub fn alone() -> std::fs::File {
    let path = hapfic_tests::hapfic().with_file_name("realtime-tests.lock");
    let file = std::fs::OpenOptions::new().create(true).truncate(false).write(true).open(path).unwrap();
    flock(&file, FlockOperation::LockExclusive).unwrap();
    file
}

#[test]
fn realtime_run_complete_within_bounds() {
    let _alone = alone();
    let stack = Stack::new();
    stack.run(&["run", "floor", "--duration", "4", "--log", "run.mcap", "--summary-json", "summary.json"]).expect(0);
    assert_eq!(expect_complete(&stack.path("run.mcap")), 4000);
    let text = std::fs::read_to_string(stack.path("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(summary["completed"], true);
    assert_eq!(summary["recorder"]["lost"], 0);
    assert_eq!(summary["timing"]["allocations"], 0, "real-time code must not allocate");
    for axis in 0..3 {
        let number = |path: [&str; 2]| summary[path[0]][path[1]][axis].as_f64().unwrap();
        assert!(number(["force_command", "max_n"]) <= number(["force_command", "limit_n"]));
        // The machine may cause missed ticks; then the bound of the law does not apply.
        if summary["timing"]["missed_ticks"] == 0 {
            assert!(number(["tracking", "max_m"]) <= number(["tracking", "bound_m"]));
        }
    }
}

#[test]
fn realtime_off_run_complete() {
    let _alone = alone();
    let stack = Stack::new();
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
fn gate_core_taken_spare_thread_answers() {
    const REPETITIONS: u32 = 20;
    const STEAL_NS: u64 = 5_000_000;
    let _alone = alone();
    let stack = Stack::new();
    std::fs::write(stack.path("steady.toml"), running::unscripted(&stack)).unwrap();
    let run = stack.start(&["run", "steady.toml", "--duration", "3600", "--log", "run.mcap", "--summary-json", "summary.json"]);
    let _ = running::status_at(&stack, 500);
    let cores = ["hapfic-gate", "hapfic-gate-2"].map(|name| core_of(run.pid(), name));
    // Without privileges, or with one core, the gate sleeps on the shared core, and has no spare thread.
    let has_spare = realtime::may_fifo(80) && realtime::usable_cores().len() >= 2;
    assert_eq!(cores[1].is_some(), has_spare, "gate and spare are on the cores {cores:?}");
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
