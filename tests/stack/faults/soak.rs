//! Short soak: the surviving processes do not grow while others are lost. `just soak` is the long one.

use super::trace::EventTrace;
use crate::log_file::expect_complete;
use crate::realtime::realtime_lock;
use hapfic_tests::{StackSandbox, children_of};
use std::path::Path;
use std::time::{Duration, Instant};

/// Resources of a process: resident memory [kB], threads, open files.
#[derive(Clone, Copy, Debug)]
struct ProcessResources {
    resident_kb: u64,
    threads: u64,
    files: usize,
}

fn resources(pid: u32) -> ProcessResources {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let number = |name: &str| {
        let line = status.lines().find_map(|l| l.strip_prefix(name)).unwrap();
        line.split_whitespace().next().unwrap().parse().unwrap()
    };
    let files = std::fs::read_dir(format!("/proc/{pid}/fd")).unwrap().count();
    ProcessResources { resident_kb: number("VmRSS:"), threads: number("Threads:"), files }
}

/// Number of files of a run in shared memory, and in its folder.
fn shared_files(run: &str) -> usize {
    fn below(folder: &Path) -> usize {
        let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
        entries.flatten().map(|e| 1 + below(&e.path())).sum()
    }
    let named = std::fs::read_dir("/dev/shm").unwrap().flatten().filter(|e| e.file_name().to_string_lossy().starts_with(run));
    named.map(|e| 1 + below(&e.path())).sum()
}

#[test]
fn soak_survivors_do_not_grow() {
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
    let faults = "fault=[{kind=\"kill\",process=[\"controller\",\"standby\",\"planner\"],random={count=60,from_s=1.0,to_s=12.0}},\
                  {kind=\"stop\",process=[\"controller\",\"standby\",\"planner\"],for_ms=20,random={count=15,from_s=1.0,to_s=12.0}},\
                  {kind=\"kill\",process=\"controllers\",random={count=5,from_s=1.0,to_s=12.0}}]";
    let set = ["--set", faults, "--set", "supervisor.restart_budget=1000", "--set", "supervisor.restart_backoff_ms=0"];
    let run = [&["run", "floor", "--duration", "16", "--log", "run.mcap"][..], &set].concat();
    let mut run = stack.start(&run);
    let children = run.children(&["plant", "planner", "controller", "standby", "gate", "spare_gate", "recorder"]);
    let pid = |process| children.iter().find(|(name, _)| name == process).unwrap().1;
    let launcher = run.pid();
    let survivors = [launcher, pid("supervisor"), pid("plant"), pid("gate"), pid("spare_gate"), pid("recorder")];
    let registered = std::fs::read_dir(stack.path("hapfic")).unwrap().flatten().next().unwrap().path();
    let name = registered.file_stem().unwrap().to_str().unwrap().to_owned();
    let at = |seconds: u64, begun: Instant| {
        while begun.elapsed() < Duration::from_secs(seconds) {
            std::thread::sleep(Duration::from_millis(20));
        }
        (survivors.map(resources), shared_files(&name), children_of(launcher).len())
    };
    let begun = Instant::now();
    // Resources of the first losses stay, and serve the later ones.
    let before = at(4, begun);
    let after = at(15, begun);
    run.finish().expect(0);
    assert_eq!(expect_complete(&stack.path("run.mcap")), 16_000);
    let trace = EventTrace::read(&stack.path("run.mcap"));
    let lost = trace.events.iter().filter(|e| e.kind == "lost").count();
    assert!(lost >= 70, "{lost} losses");
    assert_eq!(after.2, 8, "found {} processes at the end, expected 8", after.2);
    for (before, after) in before.0.iter().zip(&after.0) {
        assert_eq!(before.threads, after.threads);
        assert!(after.files <= before.files + 2, "{before:?} -> {after:?}");
        // Queues that a late recorder fills touch pages that stay.
        assert!(after.resident_kb <= before.resident_kb + 12_288, "{before:?} -> {after:?}");
    }
    assert!(after.1 <= before.1 + 8, "{} files in shared memory, then {}", before.1, after.1);
}
