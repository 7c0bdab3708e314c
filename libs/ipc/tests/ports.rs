//! Ports over iceoryx2, as the stack uses them.
#![allow(clippy::unwrap_used, missing_docs)]

use hapfic_ipc::{Bus, Domain, Input, Output, Wait, topic};
use hapfic_messages::Credit;

/// Namespace of a test.
struct Namespace {
    prefix: String,
    folder: tempfile::TempDir,
}

impl Namespace {
    fn new(name: &str) -> Self {
        Self { prefix: format!("ht{name}{}_", std::process::id()), folder: tempfile::tempdir().unwrap() }
    }

    fn bus(&self) -> Bus {
        let domain = Domain::new(&self.prefix, self.folder.path().to_str().unwrap()).unwrap();
        Bus::open(&domain, "test").unwrap()
    }
}

impl Drop for Namespace {
    fn drop(&mut self) {
        // What iceoryx2 keeps of a domain without nodes; in a run the launcher removes it.
        for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
            if entry.file_name().to_str().is_some_and(|name| name.starts_with(&self.prefix)) {
                std::fs::remove_file(entry.path()).unwrap();
            }
        }
    }
}

#[test]
fn output_warm_up_sends_nothing() {
    let namespace = Namespace::new("r");
    let bus = namespace.bus();
    let mut output = bus.output(&topic::CREDIT).unwrap();
    let mut input = bus.input(&topic::CREDIT, Wait::No).unwrap();
    for tick in 0..100 {
        for _ in 0..3 {
            output.warm_up(&Credit { tick: -7 });
        }
        assert_eq!(input.next().unwrap(), None, "tick {tick}");
        output.send(&Credit { tick }).unwrap();
        assert_eq!(input.next().unwrap().unwrap().tick, tick);
    }
}

#[test]
fn ports_with_loan_move_between_threads() {
    let namespace = Namespace::new("t");
    let bus = namespace.bus();
    let mut ports: (Output<Credit>, Input<Credit>) =
        (bus.output(&topic::CREDIT).unwrap(), bus.input(&topic::CREDIT, Wait::No).unwrap());
    for tick in 0..50 {
        ports = std::thread::scope(|scope| {
            let thread = scope.spawn(move || {
                let (mut output, mut input) = ports;
                output.preloan();
                output.send(&Credit { tick }).unwrap();
                // The loan moves back with the port.
                output.preloan();
                assert_eq!(input.next().unwrap().unwrap().tick, tick);
                (output, input)
            });
            thread.join().unwrap()
        });
    }
}

/// `unsafe impl Send` of `Output` and `Input` rests on iceoryx2's internals, read in this version.
#[test]
fn ports_rest_on_the_iceoryx2_that_was_read() {
    let lock = include_str!("../../../Cargo.lock");
    let version = lock.split("[[package]]").find(|p| p.contains("name = \"iceoryx2\"\n")).unwrap();
    assert!(
        version.contains("version = \"0.10.0\""),
        "iceoryx2 has changed: check in its sources that ports of `ipc::Service` are kept on one thread by \
         `arc_sync_policy::SingleThreaded` alone (see the SAFETY comments in ports.rs), then change this test:{version}"
    );
}
