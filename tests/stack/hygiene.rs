//! What real-time threads must not do: allocate, fault, call the system for more than waking and waiting.

mod calls;

use crate::realtime::alone;
use crate::running;
use calls::{Call, Calls};
use hapfic_log::{Reader, Record};
use hapfic_tests::Stack;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

/// The threads that a tick passes through, by the name of what they tell of themselves.
const PROCESSES: [&str; 5] = ["plant", "supervisor", "controller", "standby", "planner"];
/// From this tick on no page may be new. The foot touches the floor later. Faults are counted once in 1000 ticks.
const WARM: i64 = 1000;

/// What a process has told of a run.
#[derive(Debug, Default)]
struct Told {
    /// Ticks it worked in, the first apart.
    ticks: u64,
    /// Its heap allocations in them.
    allocations: u64,
    /// Page faults so far: when it was warm, and at the end of its last tick.
    warm: Option<u32>,
    end: Option<u32>,
}

fn told(log: &Path) -> BTreeMap<String, Told> {
    let mut all = BTreeMap::<String, Told>::new();
    for entry in Reader::open(log).unwrap() {
        let Record::Timing(timing) = entry.unwrap().record else { continue };
        let told = all.entry(timing.process).or_default();
        match timing.phase.as_str() {
            "running" if timing.tick > 0 => {
                told.ticks += 1;
                told.allocations += u64::from(timing.allocations);
                if timing.tick >= WARM {
                    told.warm.get_or_insert(timing.page_faults);
                }
            }
            "finished" => {
                told.end.get_or_insert(timing.page_faults);
            }
            _ => {}
        }
    }
    all
}

/// A page that has been used stays whether or not memory may be locked, as long as the machine is not short of it.
#[test]
fn no_real_time_thread_allocates_or_faults() {
    let _alone = alone();
    let stack = Stack::new();
    stack.run(&["run", "floor", "--duration", "5", "--log", "run.mcap"]).expect(0);
    let told = told(&stack.path("run.mcap"));
    for process in PROCESSES {
        let one = &told[process];
        assert!(one.ticks > 4000, "{process} has accounted for {} of 4999 ticks", one.ticks);
        assert_eq!(one.allocations, 0, "{process} allocated between receiving and sending");
        let (warm, end) = (one.warm.unwrap(), one.end.unwrap());
        assert_eq!(end - warm, 0, "page faults of {process} after {WARM} ticks; {warm} before");
    }
}

/// The gate's alarm: only where the gate sleeps until a request comes.
const ALARM: &str = "hapfic-alarm";

/// System calls a tick, at most, of each thread: waking others, waiting for them, sleeping until a time. docs/performance.md says what
/// each is for. A thread that is late finds its doorbell rung, or its time past, and does not sleep; or finds the others asleep, and has to
/// wake them. Being looked at makes it late.
fn expected(gate_busy_polls: bool) -> Vec<(&'static str, [(Call, f64); 3])> {
    let calls = |wake, wait, sleep| [(Call::Wake, wake), (Call::Wait, wait), (Call::Sleep, sleep)];
    let mut expected = vec![
        ("hapfic-plant", calls(1.0, 1.0, 1.0)),
        ("hapfic-controll", calls(2.0, 1.0, 1.0)),
        ("hapfic-standby", calls(1.0, 1.0, 0.0)),
        ("hapfic-planner", calls(1.0, 1.0, 0.0)),
        ("hapfic-plant-al", calls(0.0, 0.0, 1.0)),
    ];
    expected.extend(if gate_busy_polls {
        vec![("hapfic-gate", calls(2.0, 1.0, 1.0))]
    } else {
        vec![("hapfic-gate", calls(2.0, 2.0, 0.0)), (ALARM, calls(0.0, 0.0, 1.0))]
    });
    expected
}
/// How far the average may be off: less than one call in four ticks.
const TOLERANCE: f64 = 0.25;

fn as_expected(calls: &Calls, expected: &[(Call, f64)]) -> bool {
    let at_most = expected.iter().all(|(call, times)| calls.in_a_tick(*call) < times + TOLERANCE);
    let any = expected.iter().map(|(call, _)| calls.in_a_tick(*call)).sum::<f64>() > 0.5;
    at_most && any
}

/// How long a thread is looked at.
const LOOK: Duration = Duration::from_millis(500);
/// Being looked at makes each call several times as long, and a machine may be busy: only what is found again and again is so.
const ATTEMPTS: u32 = 8;

/// Threads of a process by name.
fn threads(pid: u32) -> Vec<(String, String)> {
    let tasks = std::fs::read_dir(format!("/proc/{pid}/task")).unwrap().flatten();
    let named = |task: std::fs::DirEntry| {
        let name = std::fs::read_to_string(task.path().join("comm")).ok()?;
        Some((name.trim_end().to_owned(), task.file_name().to_str()?.to_owned()))
    };
    tasks.filter_map(named).collect()
}

/// What a thread calls; `None` if it cannot be seen here.
fn traced(tid: &str, trace: &Path) -> Option<Calls> {
    let mut strace = Command::new("strace");
    strace.args(["-qq", "-ttt", "-p", tid, "-o"]).arg(trace).stderr(Stdio::null());
    let mut strace = strace.spawn().ok()?;
    std::thread::sleep(LOOK);
    // Asked to, it leaves the thread to itself.
    let _ = rustix::process::kill_process(rustix::process::Pid::from_child(&strace), rustix::process::Signal::INT);
    strace.wait().unwrap();
    let calls = Calls::read(&std::fs::read_to_string(trace).ok()?);
    (calls.ticks > 0.5 * LOOK.as_secs_f64() * 1e3).then_some(calls)
}

#[test]
fn a_tick_calls_the_system_to_wake_and_to_wait_and_for_nothing_else() {
    let skip = || {
        assert!(std::env::var_os("HAPFIC_NEEDS_STRACE").is_none(), "strace is missing, or may not look at threads");
        std::io::Write::write_all(&mut std::io::stderr(), b"skipped: strace is missing, or may not look at threads\n").unwrap();
    };
    let _alone = alone();
    let stack = Stack::new();
    let mut run = running::start(&stack, "steady", "realtime");
    let children = run.children(&["plant", "controller", "standby", "planner"]);
    // Everybody has met everybody, and is warm.
    let _ = running::status_at(&stack, 500);
    let pids = children.iter().map(|(_, pid)| *pid).chain([run.pid()]);
    let threads: BTreeMap<String, String> = pids.flat_map(threads).collect();
    for (name, expected) in expected(!threads.contains_key(ALARM)) {
        for attempt in 1.. {
            let Some(calls) = traced(&threads[name], &stack.path("calls.txt")) else { return skip() };
            // Of any call of any tick: the name.
            assert_eq!(calls.others(), "", "{name}");
            if as_expected(&calls, &expected) {
                break;
            }
            assert!(attempt < ATTEMPTS, "{name}: found {calls:?}, expected in a tick at most {expected:?}");
        }
    }
    run.signal(rustix::process::Signal::INT);
    run.finish().expect_nothing_left();
}
