//! Every kind of chain runs in three real processes, and leaves no file behind.
#![allow(clippy::unwrap_used)]

use hapfic_ipc::clock;
use std::process::Command;

const PROGRAM: &str = env!("CARGO_BIN_EXE_hapfic-peers");
const COUNT: u64 = 50;
/// Period of the chain [ns], longer than the timeout of a message.
const PERIOD_NS: u64 = 10_000_000;

fn kinds() -> Vec<String> {
    let output = Command::new(PROGRAM).arg("kinds").output().unwrap();
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
}

#[test]
fn kinds_listed_include_default_ones() {
    let kinds = kinds();
    for kind in ["iceoryx2-event", "zenoh-shm", "zenoh", "zeromq"] {
        assert!(kinds.iter().any(|k| k == kind), "found {kinds:?}, expected {kind}");
    }
}

#[test]
fn chain_every_kind_returns_ordered_samples() {
    for kind in kinds() {
        // Late enough for the slowest kind to connect.
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
        let measured: hapfic_diagnostics::ChainMeasurement = serde_json::from_str(lines[1]).unwrap();
        assert_eq!(measured.kind, kind);
        assert_eq!(measured.samples.len() as u64, COUNT, "{kind}");
        let mut returned = 0;
        for (i, sample) in (0..).zip(&measured.samples) {
            assert_eq!(sample.due_ns, start + i * PERIOD_NS, "{kind}");
            if sample.end_ns > 0 {
                returned += 1;
                assert!(sample.due_ns <= sample.wake_ns && sample.wake_ns <= sample.end_ns, "{kind}: {sample:?}");
            }
        }
        // The machine decides how many are in time. Before `ready` the driver has seen fifty in a row.
        assert!(returned > 0, "{kind}: found no message back of {COUNT}, expected one or more");
        let name = format!("hapfic-chain-{driver}-");
        let remaining: Vec<_> = std::fs::read_dir("/dev/shm").unwrap().flatten().map(|e| e.file_name()).collect();
        assert!(
            !remaining.iter().any(|file| file.to_string_lossy().starts_with(&name)),
            "{kind}: found remaining files {remaining:?}"
        );
    }
}
