//! Chains of every kind of this crate, with real processes: asserts counts and order, no durations.
#![allow(clippy::unwrap_used)]

use hapfic_diagnostics::{ChainMeasurement, Core, MeasurementPlan, TIMER, kernel_kinds};
use std::process::{Command, Output};

const COUNT: u64 = 50;

fn run(arguments: &[String]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hapfic-chain")).args(arguments).output().unwrap()
}

fn plan(kind: &str, sizes: &[u32]) -> MeasurementPlan {
    MeasurementPlan {
        kind: kind.to_owned(),
        core: vec![Core(None)],
        // No privileges: the tests run without.
        priority: vec![0],
        start_ns: hapfic_ipc::clock::now_ns() + 1_500_000_000,
        period_ns: 8_000_000,
        count: COUNT,
        sizes: sizes.to_vec(),
        above_ns: 0,
    }
}

fn measure(plan: &MeasurementPlan) -> ChainMeasurement {
    let output = run(&plan.arguments());
    let (out, err) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert!(output.status.success(), "{err}");
    let lines: Vec<_> = out.lines().collect();
    let [ready, line] = lines[..] else { panic!("{out}") };
    assert_eq!(ready, "ready");
    ChainMeasurement::parse(line).unwrap()
}

#[test]
fn chain_each_kind_answers_in_order() {
    for kind in kernel_kinds() {
        for sizes in [&[1800, 500, 700][..], &[8]] {
            let plan = plan(kind.name(), sizes);
            let measured = measure(&plan);
            assert_eq!((measured.kind.as_str(), measured.hops, measured.count), (kind.name(), 3, COUNT));
            assert_eq!(measured.granted, [0, 0, 0]);
            for (i, sample) in measured.samples.iter().enumerate() {
                assert_eq!(sample.due_ns, plan.start_ns + i as u64 * plan.period_ns);
            }
            // `parse` has checked the order of the stamps. A loaded machine may lose some messages, but not most.
            let answered = measured.samples.iter().filter(|s| s.round_ns().is_some()).count();
            assert!(answered > COUNT as usize / 2, "{}: {answered} of {COUNT} answered", kind.name());
        }
    }
}

#[test]
fn timer_reports_samples_above_threshold_only() {
    let all = measure(&plan(TIMER, &[8]));
    assert_eq!((all.hops, all.count), (0, COUNT));
    assert!(all.samples.len() > COUNT as usize / 2);
    let none = measure(&MeasurementPlan { above_ns: u64::MAX, ..plan(TIMER, &[8]) });
    assert_eq!((none.count, none.samples.len()), (COUNT, 0));
}

#[test]
fn kinds_are_listed_and_unknown_kind_is_rejected() {
    let listed = String::from_utf8(run(&["kinds".to_owned()]).stdout).unwrap();
    assert_eq!(listed.lines().collect::<Vec<_>>(), kernel_kinds().map(|kind| kind.name()));
    let rejected = run(&plan("pigeon", &[8]).arguments());
    let message = String::from_utf8(rejected.stderr).unwrap();
    assert_eq!(rejected.status.code(), Some(2));
    assert!(message.contains("pigeon") && message.contains("futex, eventfd, datagram, timer"), "{message}");
}

#[test]
fn relays_killed_driver_end() {
    let plan = MeasurementPlan { start_ns: hapfic_ipc::clock::now_ns() + 3_600_000_000_000, ..plan("futex", &[8]) };
    let mut driver = Command::new(env!("CARGO_BIN_EXE_hapfic-chain"))
        .args(plan.arguments())
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut ready = String::new();
    std::io::BufRead::read_line(&mut std::io::BufReader::new(driver.stdout.as_mut().unwrap()), &mut ready).unwrap();
    let children = std::fs::read_to_string(format!("/proc/{0}/task/{0}/children", driver.id())).unwrap_or_default();
    let relays: Vec<String> = children.split_whitespace().map(|pid| format!("/proc/{pid}")).collect();
    driver.kill().unwrap();
    driver.wait().unwrap();
    assert_eq!((ready.as_str(), relays.len()), ("ready\n", 2), "{children}");
    let begun = std::time::Instant::now();
    // A zombie keeps its entry, but has no memory.
    let alive = |path: &String| std::fs::read_to_string(format!("{path}/statm")).is_ok_and(|s| !s.starts_with("0 "));
    while relays.iter().any(alive) {
        assert!(begun.elapsed().as_secs() < 10, "a relay has outlived its driver");
        std::thread::yield_now();
    }
}
