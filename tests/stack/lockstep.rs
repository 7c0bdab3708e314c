//! Lockstep: the same scenario and seed give the same bytes, under any load of the machine.

use crate::log_file::{Streams, expect_complete, streams};
use hapfic_config::Settings;
use hapfic_log::{Names, Reader, Record, convert, proto};
use hapfic_simulation::Simulation;
use hapfic_tests::StackSandbox;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Topics that are functions of scenario and seed alone; `/timing` has wall-clock times.
const DETERMINISTIC: [&str; 10] =
    ["/state", "/reference", "/request", "/request/standby", "/command", "/operator", "/event", "/tf", "/scene", "/log"];

fn run(stack: &StackSandbox, name: &str, arguments: &[&str]) -> Streams {
    let log = format!("{name}.mcap");
    let mut all = vec!["run", "floor", "--clock", "lockstep", "--log", &log];
    all.extend(arguments);
    stack.run(&all).expect(0);
    expect_complete(&stack.path(&log));
    streams(&stack.path(&log))
}

fn expect_same(a: &Streams, b: &Streams) {
    for topic in DETERMINISTIC {
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
fn lockstep_loaded_machine_same_bytes() {
    let stack = StackSandbox::new();
    let quiet = run(&stack, "quiet", &["--duration", "5"]);
    assert_eq!(quiet["/state"].len(), 5000);
    // More busy threads than cores, so the kernel preempts every process of the stack again and again.
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
fn lockstep_other_law_other_bytes() {
    let stack = StackSandbox::new();
    let ours = run(&stack, "ours", &["--duration", "4"]);
    let paper = run(&stack, "paper", &["--duration", "4", "--set", "controller.fidelity=paper"]);
    assert_ne!(ours["/state"], paper["/state"]);
}

#[test]
fn lockstep_parallel_runs_isolated() {
    let stack = StackSandbox::new();
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

/// Logged messages that the simulation in one process makes as well.
#[derive(Default)]
struct LoggedMessages {
    names: Names,
    states: Vec<proto::State>,
    references: Vec<proto::Reference>,
    commands: Vec<proto::Command>,
    sets: Vec<proto::Operator>,
}

impl LoggedMessages {
    fn read(log: &Path) -> Self {
        let reader = Reader::open(log).unwrap();
        let mut logged = Self { names: reader.names(), ..Self::default() };
        for entry in reader {
            match entry.unwrap().record {
                Record::State(m) => logged.states.push(m),
                Record::Reference(m) => logged.references.push(m),
                Record::Command(m) => logged.commands.push(m),
                Record::Operator(m) => logged.sets.push(m),
                _ => {}
            }
        }
        logged
    }
}

/// Asserts equal numbers and equal bytes; the sign of a zero counts.
fn expect_same_bytes<M: prost::Message + PartialEq + std::fmt::Debug>(logged: &M, simulated: &M, tick: usize) {
    assert_eq!(logged, simulated, "tick {tick}: left is logged, right is simulated");
    assert!(logged.encode_to_vec() == simulated.encode_to_vec(), "tick {tick}: the same numbers with other bits: {logged:?}");
}

#[test]
fn simulation_one_process_same_bits() {
    for (scenario, seconds) in [("box", "4"), ("floor", "2")] {
        let stack = StackSandbox::new();
        stack.run(&["run", scenario, "--clock", "lockstep", "--duration", seconds, "--log", "run.mcap"]).expect(0);
        let ticks = expect_complete(&stack.path("run.mcap"));
        let logged = LoggedMessages::read(&stack.path("run.mcap"));
        assert_eq!(ticks, 1000 * seconds.parse::<usize>().unwrap());
        assert_eq!((logged.commands.len(), logged.references.len()), (ticks, ticks), "{scenario}");

        let mut simulation = Simulation::new(&Settings::load(scenario, &[]).unwrap()).unwrap();
        let mut sets: Vec<proto::Operator> = Vec::new();
        for tick in 0..ticks {
            let simulated = simulation.step().unwrap();
            expect_same_bytes(&logged.states[tick], &convert::state(&simulated.state, &logged.names), tick);
            expect_same_bytes(&logged.references[tick], &convert::reference(&simulated.reference), tick);
            expect_same_bytes(&logged.commands[tick], &convert::command(&simulated.command), tick);
            let next = &simulated.operator.next;
            if sets.last().is_none_or(|last| last.version < next.version) {
                sets.push(convert::operator(next));
            }
        }
        assert!(sets.len() > 2, "{scenario}: found {} parameter sets, expected more than 2", sets.len());
        assert_eq!(logged.sets, sets, "{scenario}");
    }
}
