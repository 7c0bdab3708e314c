//! Faults of the machine: a full disk, CPU hogs, a limit on locked memory.

use super::trace::EventTrace;
use crate::log_file::expect_complete;
use hapfic_tests::StackSandbox;
use std::process::Command;

/// Small file system in memory, unmounted when dropped.
struct SmallDisk<'a>(&'a std::path::Path);

impl<'a> SmallDisk<'a> {
    /// Mounts it; `None` if this user may not mount.
    fn mount(folder: &'a std::path::Path) -> Option<Self> {
        std::fs::create_dir(folder).unwrap();
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", "size=4m", "tmpfs"]).arg(folder).status();
        mounted.is_ok_and(|status| status.success()).then_some(Self(folder))
    }
}

impl Drop for SmallDisk<'_> {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("--lazy").arg(self.0).status();
    }
}

#[test]
fn full_disk_ends_run_log_readable() {
    let stack = StackSandbox::new();
    let folder = stack.path("small");
    let Some(_disk) = SmallDisk::mount(&folder) else {
        std::io::Write::write_all(&mut std::io::stderr(), b"skipped: this user may not mount a tmpfs\n").unwrap();
        return;
    };
    let faults = "fault=[{kind=\"full_disk\",at_s=0.5}]";
    let words = ["run", "floor", "--clock", "lockstep", "--log", "small/run.mcap", "--set"];
    let refused = stack.run(&[words.as_slice(), &["recorder.min_free_mb=64"]].concat());
    assert!(
        refused.expect(2).err.contains("4 MB free on its disk, expected at least recorder.min_free_mb = 64"),
        "{}",
        refused.err
    );
    let any = ["--set", "recorder.min_free_mb=0"];
    let end = stack.run(&[words.as_slice(), &[faults, "--duration", "60"], &any].concat());
    end.expect(3);
    assert!(end.out.contains("FAULT              recorder cannot write the log any further"), "{}", end.out);
    let log = folder.join("run.mcap");
    assert!(!folder.join("run.filler").exists(), "found run.filler, expected its removal");
    // Recovered to another disk, if the log is not whole.
    let recovered = stack.path("recovered.mcap");
    stack.run(&["recover", "small/run.mcap", "--output", recovered.to_str().unwrap()]).expect(0);
    let trace = EventTrace::read(if recovered.exists() { &recovered } else { &log });
    assert!(trace.commands.len() > 300, "{} commands", trace.commands.len());

    // The same, and control goes on: the summary says what is missing.
    std::fs::remove_file(&log).unwrap();
    let go_on = ["--duration", "3", "--set", "recorder.on_failure=\"continue\"", "--summary-json", "end.json"];
    let end = stack.run(&[words.as_slice(), &[faults], &any, &go_on].concat());
    end.expect(0);
    let summary: serde_json::Value = serde_json::from_slice(&std::fs::read(stack.path("end.json")).unwrap()).unwrap();
    assert_eq!((&summary["completed"], &summary["timing"]["brake_ticks"]), (&true.into(), &0.into()), "{summary}");
    let recorder = &summary["recorder"];
    assert!(recorder["problem"].as_str().unwrap().starts_with("ended early: "), "{recorder}");
    assert!(recorder["lost"].as_u64().unwrap() > 1000, "{recorder}");
}

#[test]
fn full_disk_shared_disk_rejected() {
    let stack = StackSandbox::new();
    let disk = rustix::fs::statfs(stack.path("")).unwrap();
    if disk.f_type as u64 == 0x0102_1994 && disk.f_blocks as u64 * disk.f_bsize as u64 <= 256 << 20 {
        // The temporary folder is a small tmpfs, which the fault may fill.
        return;
    }
    let faults = "fault=[{kind=\"full_disk\",at_s=0.5}]";
    let end = stack.run(&["run", "floor", "--clock", "lockstep", "--log", "new/run.mcap", "--set", faults]);
    end.expect(2);
    assert!(end.err.contains("full_disk") && end.err.contains("expected a tmpfs"), "{}", end.err);
    assert!(!stack.path("new/run.mcap").exists());
}

#[test]
fn hog_every_core_lockstep_complete() {
    let stack = StackSandbox::new();
    let faults = "fault=[{kind=\"hog\",at_s=0.2,for_ms=1000}]";
    stack.run(&["run", "floor", "--clock", "lockstep", "--duration", "2", "--log", "run.mcap", "--set", faults]).expect(0);
    assert_eq!(expect_complete(&stack.path("run.mcap")), 2000);
    let trace = EventTrace::read(&stack.path("run.mcap"));
    assert!(trace.events.iter().any(|e| e.kind == "injected" && e.text.contains("hog")), "{}", trace.text());
}

#[test]
fn memory_lock_running_process_limited() {
    let stack = StackSandbox::new();
    let mut run = stack.start(&["run", "floor", "--clock", "lockstep", "--duration", "3600", "--log", "run.mcap"]);
    let children = run.children(&["plant", "planner", "controller", "standby"]);
    let planner = children.iter().find(|(name, _)| name == "planner").unwrap().1;
    let limit = || {
        let limits = std::fs::read_to_string(format!("/proc/{planner}/limits")).unwrap();
        limits.lines().find(|line| line.starts_with("Max locked memory")).unwrap().to_owned()
    };
    assert!(!limit().contains(" 65536 "), "{}", limit());
    run.wait_for(&stack.path("run.mcap"), 100_000);
    let injected = stack.run(&["inject", "kind=memory_lock", "process=planner"]);
    assert_eq!(injected.code, Some(0), "{}", injected.err);
    let begun = std::time::Instant::now();
    while !limit().contains(" 65536 ") {
        assert!(begun.elapsed() < std::time::Duration::from_secs(60), "{}", limit());
        std::thread::yield_now();
    }
    assert_eq!(stack.run(&["stop"]).code, Some(0));
    run.finish().expect(3);
    let trace = EventTrace::read(&stack.path("run.mcap"));
    assert_eq!(trace.events("injected", "planner").len(), 1, "{}", trace.text());
}
