//! Ports over iceoryx2, as the stack uses them.
#![allow(clippy::unwrap_used, missing_docs)]

use hapfic_ipc::{Bus, Domain, Input, Output, Wait, topic};
use hapfic_messages::Credit;

/// A corner of this test's own.
struct Corner {
    prefix: String,
    folder: tempfile::TempDir,
}

impl Corner {
    fn new(name: &str) -> Self {
        Self { prefix: format!("ht{name}{}_", std::process::id()), folder: tempfile::tempdir().unwrap() }
    }

    fn bus(&self) -> Bus {
        let domain = Domain::new(&self.prefix, self.folder.path().to_str().unwrap()).unwrap();
        Bus::open(&domain, "test").unwrap()
    }
}

impl Drop for Corner {
    fn drop(&mut self) {
        // What iceoryx2 keeps of a domain that nobody is in any more; the supervisor removes a run's.
        for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
            if entry.file_name().to_str().is_some_and(|name| name.starts_with(&self.prefix)) {
                std::fs::remove_file(entry.path()).unwrap();
            }
        }
    }
}

#[test]
fn a_rehearsal_sends_nothing_and_the_next_message_is_the_next() {
    let corner = Corner::new("r");
    let bus = corner.bus();
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
fn ports_go_from_thread_to_thread_with_what_they_have_on_loan() {
    let corner = Corner::new("t");
    let bus = corner.bus();
    let mut ports: (Output<Credit>, Input<Credit>) =
        (bus.output(&topic::CREDIT).unwrap(), bus.input(&topic::CREDIT, Wait::No).unwrap());
    for tick in 0..50 {
        ports = std::thread::scope(|scope| {
            let there = scope.spawn(move || {
                let (mut output, mut input) = ports;
                output.preloan();
                output.send(&Credit { tick }).unwrap();
                // On loan when it goes back.
                output.preloan();
                assert_eq!(input.next().unwrap().unwrap().tick, tick);
                (output, input)
            });
            there.join().unwrap()
        });
    }
}
