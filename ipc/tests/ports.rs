//! Ports over iceoryx2, as the stack uses them.
#![allow(clippy::unwrap_used, missing_docs)]

use hapfic_ipc::message::Credit;
use hapfic_ipc::{Bus, Domain, Input, Output, Wait, topic};

/// A domain of this test's own, and its folder.
fn bus(name: &str) -> (tempfile::TempDir, Bus) {
    let folder = tempfile::tempdir().unwrap();
    let domain = Domain::new(&format!("hp{name}{}_", std::process::id()), folder.path().to_str().unwrap()).unwrap();
    let bus = Bus::open(&domain, "test").unwrap();
    (folder, bus)
}

#[test]
fn a_rehearsal_sends_nothing_and_the_next_message_is_the_next() {
    let (_folder, bus) = bus("r");
    let mut output = bus.output(&topic::CREDIT).unwrap();
    let mut input = bus.input(&topic::CREDIT, Wait::No).unwrap();
    for tick in 0..100 {
        for _ in 0..3 {
            output.rehearse(&Credit { tick: -7 });
        }
        assert_eq!(input.next().unwrap(), None, "tick {tick}");
        output.send(&Credit { tick }).unwrap();
        assert_eq!(input.next().unwrap().unwrap().tick, tick);
    }
}

#[test]
fn ports_go_from_thread_to_thread_with_what_they_have_on_loan() {
    let (_folder, bus) = bus("t");
    let mut ports: (Output<Credit>, Input<Credit>) =
        (bus.output(&topic::CREDIT).unwrap(), bus.input(&topic::CREDIT, Wait::No).unwrap());
    for tick in 0..50 {
        ports = std::thread::scope(|scope| {
            let there = scope.spawn(move || {
                let (mut output, mut input) = ports;
                output.prepare();
                output.send(&Credit { tick }).unwrap();
                // On loan when it goes back.
                output.prepare();
                assert_eq!(input.next().unwrap().unwrap().tick, tick);
                (output, input)
            });
            there.join().unwrap()
        });
    }
}
