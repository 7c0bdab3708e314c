//! Every kind of chain goes round, in three real processes, and leaves nothing behind.
#![allow(clippy::unwrap_used)]

use hapfic_ipc::clock;
use std::process::Command;

const PROGRAM: &str = env!("CARGO_BIN_EXE_hapfic-peers");
const COUNT: u64 = 50;
/// More than an answer is waited for.
const PERIOD_NS: u64 = 10_000_000;

fn kinds() -> Vec<String> {
    let output = Command::new(PROGRAM).arg("kinds").output().unwrap();
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
}

#[test]
fn there_are_the_kinds_that_the_manual_names() {
    let kinds = kinds();
    for kind in ["iceoryx2-event", "zenoh-shm", "zenoh", "zeromq"] {
        assert!(kinds.iter().any(|k| k == kind), "{kind} is missing in {kinds:?}");
    }
}

#[test]
fn messages_come_round_and_in_order_of_time() {
    for kind in kinds() {
        // Far enough ahead for the slowest to find each other.
        let start = clock::now_ns() + 3_000_000_000;
        let child = Command::new(PROGRAM)
            .args(["chain", "--kind", &kind, "--start-ns", &start.to_string(), "--period-ns", &PERIOD_NS.to_string()])
            .args(["--count", &COUNT.to_string(), "--sizes", "2048,640,1024"])
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        let driver = child.id();
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success(), "{kind}: {output:?}");
        let text = String::from_utf8(output.stdout).unwrap();
        let lines: Vec<_> = text.lines().collect();
        assert_eq!(lines.len(), 2, "{kind}: {text}");
        assert_eq!(lines[0], "ready", "{kind}");
        let measured: hapfic_diagnostics::Measured = serde_json::from_str(lines[1]).unwrap();
        assert_eq!(measured.kind, kind);
        assert_eq!(measured.samples.len() as u64, COUNT, "{kind}");
        let mut answered = 0;
        for (i, sample) in (0..).zip(&measured.samples) {
            assert_eq!(sample.due_ns, start + i * PERIOD_NS, "{kind}");
            if sample.end_ns > 0 {
                answered += 1;
                assert!(sample.due_ns <= sample.wake_ns && sample.wake_ns <= sample.end_ns, "{kind}: {sample:?}");
            }
        }
        // How many are in time is the machine's business; that fifty in a row were, before `ready`, is the driver's.
        assert!(answered > 0, "{kind}: none of {COUNT} came round");
        let name = format!("hapfic-chain-{driver}-");
        let left: Vec<_> = std::fs::read_dir("/dev/shm").unwrap().flatten().map(|e| e.file_name()).collect();
        assert!(!left.iter().any(|file| file.to_string_lossy().starts_with(&name)), "{kind} has left something: {left:?}");
    }
}
