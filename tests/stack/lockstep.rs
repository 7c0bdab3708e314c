//! Lockstep: the same scenario and seed give the same bytes, whatever the machine does meanwhile.

use crate::log_file::{Streams, expect_complete, streams};
use hapfic_tests::Stack;
use std::sync::atomic::{AtomicBool, Ordering};

/// Topics that are functions of scenario and seed alone. `/timing` has what the clock on the wall says.
const PURE: [&str; 9] = ["/state", "/reference", "/request", "/command", "/operator", "/event", "/tf", "/scene", "/log"];

fn run(stack: &Stack, name: &str, arguments: &[&str]) -> Streams {
    let log = format!("{name}.mcap");
    let mut all = vec!["run", "floor", "--clock", "lockstep", "--log", &log];
    all.extend(arguments);
    stack.run(&all).expect(0);
    expect_complete(&stack.path(&log));
    streams(&stack.path(&log))
}

fn expect_same(a: &Streams, b: &Streams) {
    for topic in PURE {
        let (a, b) = (a.get(topic), b.get(topic));
        assert!(a.is_some(), "{topic} is empty");
        let (a, b) = (a.unwrap(), b.unwrap());
        assert_eq!(a.len(), b.len(), "{topic}");
        for (i, (x, y)) in a.iter().zip(b).enumerate() {
            assert_eq!(x, y, "{topic}, message {i}");
        }
    }
}

#[test]
fn two_runs_give_the_same_bytes_on_a_loaded_machine_too() {
    let stack = Stack::new();
    let quiet = run(&stack, "quiet", &["--duration", "5"]);
    assert_eq!(quiet["/state"].len(), 5000);
    // More hogs than cores, so that every process of the stack is put aside again and again.
    let stop = AtomicBool::new(false);
    let loaded = std::thread::scope(|scope| {
        for _ in 0..2 * std::thread::available_parallelism().unwrap().get() {
            scope.spawn(|| {
                let mut x = 1_u64;
                while !stop.load(Ordering::Relaxed) {
                    x = std::hint::black_box(x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1));
                }
            });
        }
        let loaded = run(&stack, "loaded", &["--duration", "5"]);
        stop.store(true, Ordering::Relaxed);
        loaded
    });
    expect_same(&quiet, &loaded);
}

#[test]
fn another_law_gives_other_bytes() {
    let stack = Stack::new();
    let ours = run(&stack, "ours", &["--duration", "4"]);
    let paper = run(&stack, "paper", &["--duration", "4", "--set", "controller.fidelity=paper"]);
    assert_ne!(ours["/state"], paper["/state"]);
}

#[test]
fn runs_beside_each_other_do_not_see_each_other() {
    let stack = Stack::new();
    let logs = ["a.mcap", "b.mcap", "c.mcap"];
    let started: Vec<_> =
        logs.iter().map(|log| stack.start(&["run", "floor", "--clock", "lockstep", "--duration", "2", "--log", log])).collect();
    for run in started {
        run.finish().expect(0);
    }
    let a = streams(&stack.path(logs[0]));
    for log in &logs[1..] {
        expect_same(&a, &streams(&stack.path(log)));
    }
    assert_eq!(stack.registrations(), 0);
}
