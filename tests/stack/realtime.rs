//! Realtime: everything that must hold whatever the machine's timing is.

use crate::log_file::expect_complete;
use crate::running;
use hapfic_ipc::{clock, realtime};
use hapfic_tests::Stack;
use rustix::fs::{FlockOperation, flock};

/// One realtime run at a time: the lock is beside the binary that is tested.
pub fn alone() -> std::fs::File {
    let path = hapfic_tests::hapfic().with_file_name("realtime-tests.lock");
    let file = std::fs::OpenOptions::new().create(true).truncate(false).write(true).open(path).unwrap();
    flock(&file, FlockOperation::LockExclusive).unwrap();
    file
}

#[test]
fn every_tick_is_logged_and_every_bound_holds() {
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
        // Whether ticks are missed is the machine's business; what follows from it is not a bound of the law.
        if summary["timing"]["missed_ticks"] == 0 {
            assert!(number(["tracking", "max_m"]) <= number(["tracking", "bound_m"]));
        }
    }
}

#[test]
fn without_privileges_asked_for_it_runs_all_the_same() {
    let _alone = alone();
    let stack = Stack::new();
    stack.run(&["run", "floor", "--duration", "0.5", "--realtime", "off", "--log", "run.mcap"]).expect(0);
    assert_eq!(expect_complete(&stack.path("run.mcap")), 500);
}

/// Core of a thread that may run on one only, and `None` if there is no such thread.
fn core_of(pid: u32, name: &str) -> Option<usize> {
    let tasks = std::fs::read_dir(format!("/proc/{pid}/task")).unwrap().flatten();
    let status = tasks.filter_map(|task| std::fs::read_to_string(task.path().join("status")).ok());
    let field = |status: &str, field: &str| status.lines().find_map(|l| l.strip_prefix(field)).map(|l| l.trim().to_owned());
    let thread = { status }.find(|status| field(status, "Name:").is_some_and(|found| found == name))?;
    field(&thread, "Cpus_allowed_list:")?.parse().ok()
}

/// What only a host can do in earnest: the gate's core is gone for five ticks, again and again. A thread that goes before the gate has it
/// meanwhile.
#[test]
fn while_the_gate_s_core_is_taken_away_its_understudy_answers() {
    const TIMES: u32 = 20;
    const AWAY_NS: u64 = 5_000_000;
    let _alone = alone();
    let stack = Stack::new();
    std::fs::write(stack.path("steady.toml"), running::unscripted(&stack)).unwrap();
    let run = stack.start(&["run", "steady.toml", "--duration", "3600", "--log", "run.mcap", "--summary-json", "summary.json"]);
    let _ = running::status_at(&stack, 500);
    let cores = ["hapfic-gate", "hapfic-gate-2"].map(|name| core_of(run.pid(), name));
    // Without privileges, or with one core, the gate sleeps where all are, and needs nobody.
    let may = realtime::may_fifo(80) && realtime::usable_cores().len() >= 2;
    assert_eq!(cores[1].is_some(), may, "gate and spare are on the cores {cores:?}");
    if may {
        assert_ne!(cores[0], cores[1]);
        let hog = std::thread::spawn(move || {
            realtime::pin(None, cores[0].unwrap()).unwrap();
            realtime::set_fifo(80).unwrap();
            for _ in 0..TIMES {
                let end = clock::now_ns() + AWAY_NS;
                while clock::now_ns() < end {
                    std::hint::spin_loop();
                }
                clock::sleep_until(end + 4 * AWAY_NS);
            }
        });
        hog.join().unwrap();
    }
    run.signal(rustix::process::Signal::INT);
    run.finish().expect_nothing_left();
    let summary: serde_json::Value = serde_json::from_slice(&std::fs::read(stack.path("summary.json")).unwrap()).unwrap();
    let spare_ticks = summary["timing"]["spare_gate_ticks"].as_u64().unwrap();
    let expected = if may { TIMES } else { 0 };
    assert!(spare_ticks >= expected.into(), "{spare_ticks} ticks, expected at least one of five in each of {expected} times");
    assert_eq!(summary["recorder"]["lost"], 0);
    assert_eq!(summary["timing"]["allocations"], 0);
}
