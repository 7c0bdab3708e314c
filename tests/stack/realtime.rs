//! Realtime: everything that must hold whatever the machine's timing is.

use crate::log_file::expect_complete;
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
