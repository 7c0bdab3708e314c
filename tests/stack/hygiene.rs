//! Real-time threads neither allocate nor fault, and make no system calls but for waking and waiting.

mod calls;

use crate::realtime::realtime_lock;
use crate::running;
use calls::{SystemCall, SystemCalls};
use hapfic_log::{Reader, Record};
use hapfic_tests::StackSandbox;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Processes of a tick, as `/timing` names them.
const PROCESSES: [&str; 5] = ["plant", "gate", "controller", "standby", "planner"];
/// First tick without page faults [ticks]. The foot touches the floor later. Processes count faults once in 1000 ticks.
const WARM: i64 = 1000;
/// Tick at which that count is read [ticks]. The spare gate may do tick [`WARM`]: the gate then counts at its next tick.
const WARM_COUNTED: i64 = WARM + 500;

/// Account of a process over a run.
#[derive(Debug, Default)]
struct ProcessAccount {
    /// Ticks with work, without the first.
    ticks: u64,
    /// Heap allocations in these ticks.
    allocations: u64,
    /// Page faults until the tick [`WARM`], or a little later.
    warm: Option<u32>,
    /// Page faults until the end of the last tick.
    end: Option<u32>,
}

fn accounts(log: &Path) -> BTreeMap<String, ProcessAccount> {
    let mut all = BTreeMap::<String, ProcessAccount>::new();
    for entry in Reader::open(log).unwrap() {
        let Record::Timing(timing) = entry.unwrap().record else { continue };
        let account = all.entry(timing.process).or_default();
        match timing.phase.as_str() {
            "running" if timing.tick > 0 => {
                account.ticks += 1;
                account.allocations += u64::from(timing.allocations);
                if timing.tick >= WARM_COUNTED {
                    account.warm.get_or_insert(timing.page_faults);
                }
            }
            "finished" => {
                account.end.get_or_insert(timing.page_faults);
            }
            _ => {}
        }
    }
    all
}

/// A mesh of a link that is deep in an object: the hardest query of a distance.
#[test]
fn mesh_deep_in_object_allocates_nothing() {
    let stack = StackSandbox::new();
    let mesh = "v 0.125 0 -0.25\nv -0.125 0.125 0\nv -0.125 -0.125 0\nv 0 0 0.25\nf 1 2 3\nf 1 2 4\nf 2 3 4\nf 1 3 4\n";
    std::fs::write(stack.path("wedge.obj"), mesh).unwrap();
    let urdf = r#"<robot name="slide"><link name="base"/>
        <joint name="rail" type="prismatic"><parent link="base"/><child link="body"/><axis xyz="0 0 1"/>
          <limit lower="-1" upper="5" effort="100" velocity="10"/></joint>
        <link name="body"><inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
          <collision><geometry><mesh filename="wedge.obj"/></geometry></collision></link>
        <joint name="end" type="fixed"><parent link="body"/><child link="tip"/><origin xyz="0 0 1"/></joint>
        <link name="tip"><collision><geometry><sphere radius="0.05"/></geometry></collision></link></robot>"#;
    std::fs::write(stack.path("slide.urdf"), urdf).unwrap();
    let scenario = "duration_s = 1.0\n[robot]\nurdf = \"slide.urdf\"\nbase_link = \"base\"\ntip_link = \"tip\"\n\
        start_position_rad = [0.5]\n[world.floor]\n[[world.object]]\nname = \"it\"\nshape = \"box\"\nsize_m = [0.6, 0.6, 0.2]\n\
        mass_kg = 5.0\nposition_m = [0.125, 0.0, 0.1]\nstiffness_n_per_m = 3000.0\ndamping_n_s_per_m = 50.0\n\
        [[operator]]\nat_s = 0.2\ntarget_position_m = [0, 0, 1.35]\n";
    std::fs::write(stack.path("slide.toml"), scenario).unwrap();
    stack.run(&["run", "slide.toml", "--clock", "lockstep", "--log", "slide.mcap"]).expect(0);
    let touches = |entry: Result<hapfic_log::LogMessage, _>| match entry.unwrap().record {
        Record::State(state) => state.contacts.iter().any(|contact| contact.body == "body" && contact.depth > 1e-3),
        _ => false,
    };
    let deep = Reader::open(stack.path("slide.mcap")).unwrap().map(touches).filter(|touches| *touches).count();
    assert!(deep > 300, "deep in {deep} ticks");
    assert_eq!(accounts(&stack.path("slide.mcap"))["plant"].allocations, 0);
}

/// Needs no locked memory: a used page stays as long as the machine has enough memory.
#[test]
fn realtime_threads_warm_no_allocations_or_faults() {
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
    stack.run(&["run", "floor", "--duration", "5", "--log", "run.mcap"]).expect(0);
    let accounts = accounts(&stack.path("run.mcap"));
    for process in PROCESSES {
        let account = &accounts[process];
        assert!(account.ticks > 4000, "found {} ticks of {process}, expected more than 4000 of 4999", account.ticks);
        assert_eq!(account.allocations, 0, "{process} allocated between receiving and sending");
        let (warm, end) = (account.warm.unwrap(), account.end.unwrap());
        assert_eq!(end - warm, 0, "page faults of {process} after {WARM} ticks; {warm} before");
    }
}

/// Deadline timer of the gate; exists only if the gate sleeps until a request comes.
const GATE_DEADLINE_TIMER: &str = "hapfic-deadline";

/// Largest numbers of system calls of each thread in a tick: wakes, waits, sleeps until a time. docs/performance.md has
/// their reasons.
///
/// A late thread makes fewer waits and sleeps, since its doorbell has changed or its time has passed. It makes more
/// wakes if the others sleep already. Tracing makes a thread late. The two controllers change roles whenever the primary
/// was later than the standby, so their calls are those of the role, not of the name.
fn expected(gate_busy_polls: bool) -> Vec<(Thread, [(SystemCall, f64); 3])> {
    let calls = |wake, wait, sleep| [(SystemCall::Wake, wake), (SystemCall::Wait, wait), (SystemCall::Sleep, sleep)];
    let mut expected = vec![
        (Thread::Named("hapfic-plant"), calls(1.0, 1.0, 1.0)),
        (Thread::Primary, calls(2.0, 1.0, 1.0)),
        (Thread::Standby, calls(1.0, 1.0, 0.0)),
        (Thread::Named("hapfic-planner"), calls(1.0, 1.0, 0.0)),
        (Thread::Named("hapfic-gate-2"), calls(0.0, 1.0, 0.0)),
        (Thread::Named("hapfic-plant-dl"), calls(0.0, 0.0, 1.0)),
    ];
    expected.extend(if gate_busy_polls {
        vec![(Thread::Named("hapfic-gate"), calls(2.0, 1.0, 1.0))]
    } else {
        vec![(Thread::Named("hapfic-gate"), calls(2.0, 2.0, 0.0)), (Thread::Named(GATE_DEADLINE_TIMER), calls(0.0, 0.0, 1.0))]
    });
    expected
}

/// Thread that is traced: by its name, or the controller that has a role at present.
#[derive(Clone, Copy, Debug)]
enum Thread {
    Named(&'static str),
    Primary,
    Standby,
}

/// Thread names of the controllers by the process names of the status.
const CONTROLLERS: [(&str, &str); 2] = [("controller", "hapfic-controll"), ("standby", "hapfic-standby")];

impl Thread {
    /// Name of the thread when the primary is the process `primary`.
    fn name(self, primary: &str) -> &'static str {
        let controller =
            |is_primary: bool| CONTROLLERS.iter().find(|(process, _)| (*process == primary) == is_primary).unwrap().1;
        match self {
            Self::Named(name) => name,
            Self::Primary => controller(true),
            Self::Standby => controller(false),
        }
    }
}

/// Process whose requests the gate uses at present.
fn primary(stack: &StackSandbox) -> String {
    running::status_at(stack, 500)["primary"].as_str().unwrap().to_owned()
}

/// Tolerance of the average: less than one call in four ticks.
const TOLERANCE: f64 = 0.25;

fn as_expected(calls: &SystemCalls, expected: &[(SystemCall, f64)]) -> bool {
    let at_most = expected.iter().all(|(call, times)| calls.per_tick(*call) < times + TOLERANCE);
    let any = expected.iter().map(|(call, _)| calls.per_tick(*call)).sum::<f64>() > 0.5;
    at_most && any
}

/// Duration of a trace.
const TRACE_DURATION: Duration = Duration::from_millis(300);
/// Traces of a thread, most of which must be as expected. Tracing makes each call several times as long, and a machine may
/// be busy, so a single trace proves nothing.
const TRACES: usize = 5;
/// Traces with a change of roles after which the test gives up.
const MOST_CHANGES: usize = 50;

/// Threads of a process by name.
fn threads(pid: u32) -> Vec<(String, String)> {
    let tasks = std::fs::read_dir(format!("/proc/{pid}/task")).unwrap().flatten();
    let named = |task: std::fs::DirEntry| {
        let name = std::fs::read_to_string(task.path().join("comm")).ok()?;
        Some((name.trim_end().to_owned(), task.file_name().to_str()?.to_owned()))
    };
    tasks.filter_map(named).collect()
}

/// System calls of a thread; `None` if it cannot be traced here.
fn traced(tid: &str, trace: &Path) -> Option<SystemCalls> {
    let mut strace = Command::new("strace");
    strace.args(["-qq", "-ttt", "-p", tid, "-o"]).arg(trace).stderr(Stdio::null());
    let mut strace = strace.spawn().ok()?;
    std::thread::sleep(TRACE_DURATION);
    // By SIGINT strace detaches from the thread.
    let _ = rustix::process::kill_process(rustix::process::Pid::from_child(&strace), rustix::process::Signal::INT);
    strace.wait().unwrap();
    let calls = SystemCalls::read(&std::fs::read_to_string(trace).ok()?);
    (calls.ticks > 0.5 * TRACE_DURATION.as_secs_f64() * 1e3).then_some(calls)
}

#[test]
fn realtime_threads_tick_only_wakes_and_waits() {
    let skip = || {
        assert!(std::env::var_os("HAPFIC_NEEDS_STRACE").is_none(), "strace is missing, or may not trace threads");
        std::io::Write::write_all(&mut std::io::stderr(), b"skipped: strace is missing, or may not trace threads\n").unwrap();
    };
    let _lock = realtime_lock();
    let stack = StackSandbox::new();
    let mut run = running::start(&stack, "steady", "realtime");
    let children = run.children(&["plant", "controller", "standby", "planner", "gate", "spare_gate"]);
    // By then all processes are connected, and their caches are warm.
    let _ = running::status_at(&stack, 500);
    let pids = children.iter().map(|(_, pid)| *pid).chain([run.pid()]);
    let threads: BTreeMap<String, String> = pids.flat_map(threads).collect();
    let gate = children.iter().find(|(name, _)| name == "gate").unwrap().1;
    let gate_polls = self::threads(gate).iter().all(|(name, _)| name != GATE_DEADLINE_TIMER);
    for (thread, expected) in expected(gate_polls) {
        let mut traces = Vec::new();
        let mut changes = 0;
        while traces.len() < TRACES {
            let before = primary(&stack);
            let Some(calls) = traced(&threads[thread.name(&before)], &stack.path("calls.txt")) else { return skip() };
            // No other call in any tick.
            assert_eq!(calls.others(), "", "{thread:?}");
            // A trace over a change of roles belongs to none of them.
            if primary(&stack) == before {
                traces.push(calls);
            } else {
                changes += 1;
                assert!(changes < MOST_CHANGES, "the primary changed during {changes} traces of {thread:?}");
            }
        }
        let good = traces.iter().filter(|calls| as_expected(calls, &expected)).count();
        assert!(
            2 * good > TRACES,
            "{thread:?}: {good} of {TRACES} traces as expected: {traces:?}, expected in a tick at most {expected:?}"
        );
    }
    run.signal(rustix::process::Signal::INT);
    run.finish().expect_nothing_left();
}
