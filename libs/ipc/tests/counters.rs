//! Counters of allocations and page faults that a process reports: they count what it did.
//!
//! A test program of its own, since it installs the counting allocator, as the `hapfic` program does.
#![allow(clippy::unwrap_used, missing_docs)]

use hapfic_ipc::allocations::{CountingAllocator, count};
use hapfic_ipc::{Context, Input, ProcessStart, RunFile, TickTimes, Wait, topic};
use hapfic_messages::{Clock, Process, RealtimeMode, Timing};
use std::hint::black_box;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

#[test]
fn allocations_each_heap_request_counts_once() {
    let before = count();
    let mut numbers = black_box(Vec::<u64>::with_capacity(4));
    assert_eq!(count() - before, 1, "new memory");
    numbers.extend([1, 2, 3, 4]);
    assert_eq!(count() - before, 1, "within capacity");
    numbers.reserve_exact(100);
    assert_eq!(count() - before, 2, "reallocated");
    let zeros = black_box(vec![0_u64; 100]);
    assert_eq!(count() - before, 3, "zeroed memory");
    drop((numbers, zeros));
    assert_eq!(count() - before, 3, "freed");
    let own = count();
    let other = std::thread::spawn(|| {
        (0..100).for_each(|i| drop(black_box(Box::new(i))));
        count()
    });
    assert!(other.join().unwrap() >= 100);
    assert!(count() - own < 50, "each thread counts its own allocations; the start of a thread takes a few");
}

fn reported(timing: &mut Input<Timing>) -> Timing {
    timing.newest().unwrap().unwrap()
}

#[test]
fn context_account_reports_allocations_and_page_faults() {
    let folder = tempfile::tempdir().unwrap();
    let run = RunFile {
        prefix: format!("ht{}_", std::process::id()),
        root: folder.path().to_str().unwrap().to_owned(),
        scenario: "floor".to_owned(),
        log: "run.mcap".into(),
        log_name: "run.mcap".into(),
        start_unix_ns: 0,
        launched_ns: 0,
        launcher_pid: rustix::process::getppid().unwrap().as_raw_nonzero().get(),
        clock: Clock::Realtime,
        realtime: RealtimeMode::Off,
        core: None,
        standby_core: None,
        gate_core: None,
        gate_busy_polls: false,
        spare_core: None,
        start_pose: [[0.0; 3]; 2],
        settings: String::new(),
        urdf_name: String::new(),
        urdf: String::new(),
    };
    let mut context = Context::join(&run, 2000, Process::Controller, ProcessStart::default()).unwrap();
    // The test runner may end before the tests.
    rustix::process::set_parent_process_death_signal(None).unwrap();
    let mut timing = context.bus.input(&topic::TIMING, Wait::No).unwrap();
    let done = |tick| TickTimes { tick, due_ns: 0, wake_ns: 0, publish_ns: 0, latency_ns: 0 };
    // The first message connects to the receiver.
    context.account(done(1)).unwrap();
    let first = reported(&mut timing);

    for (tick, pieces) in [(2, 0), (3, 3), (4, 0)] {
        context.begin();
        for size in 0..pieces {
            black_box(vec![1_u8; 100 + size]);
        }
        context.account(done(tick)).unwrap();
        let reported = reported(&mut timing);
        assert_eq!((reported.tick, reported.allocations), (tick, pieces as u32));
    }

    let touched = black_box(vec![1_u8; 16 << 20]);
    context.account(done(500)).unwrap();
    assert_eq!(reported(&mut timing).page_faults, first.page_faults, "counted once in a thousand ticks");
    context.account(done(1001)).unwrap();
    assert!(reported(&mut timing).page_faults > first.page_faults, "{} bytes", touched.len());

    drop((timing, context));
    // What iceoryx2 keeps of a domain without nodes; in a run the launcher removes it.
    for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
        if entry.file_name().to_str().is_some_and(|name| name.starts_with(&run.prefix)) {
            std::fs::remove_file(entry.path()).unwrap();
        }
    }
}
