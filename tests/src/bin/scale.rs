//! Makes a section of a document: how many legs a machine carries, and how fast it simulates.
//!
//! `scale FILE` starts one, two, four and eight independent realtime stacks at once, measures what each takes of the machine and what
//! becomes of its ticks, and then how fast lockstep runs with processes and in one process. It writes the tables between the lines
//! `<!-- scale -->` and `<!-- end -->`. It ends with 1 if a run did not get to its end, with a line for each, and with 2 if it was
//! asked for something that cannot be.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr)]

#[path = "scale/arguments.rs"]
mod arguments;
#[path = "experiments/document.rs"]
mod document;
#[path = "scale/legs.rs"]
mod legs;
#[path = "faults/machine.rs"]
mod machine;
#[path = "faults/part.rs"]
#[allow(dead_code, reason = "shared with `faults`, which uses all of it")]
mod part;
#[path = "scale/speed.rs"]
mod speed;
#[path = "scale/tables.rs"]
mod tables;
#[path = "scale/usage.rs"]
mod usage;

use arguments::Arguments;
use rustix::fs::{FlockOperation, flock};
use std::process::ExitCode;

/// The place of the tables.
const MARKER: &str = "scale";
/// Stacks at once.
const LEGS: [usize; 4] = [1, 2, 4, 8];

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    match Arguments::read(&words).and_then(|arguments| make(&arguments, &words)) {
        Ok(shortfalls) if shortfalls.is_empty() => ExitCode::SUCCESS,
        Ok(shortfalls) => {
            shortfalls.iter().for_each(|shortfall| eprintln!("fell short: {shortfall}"));
            ExitCode::FAILURE
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(2)
        }
    }
}

/// Measures everything and writes the tables. Returns what fell short.
fn make(arguments: &Arguments, words: &[String]) -> Result<Vec<String>, String> {
    // Before minutes of running: the place is there.
    fill(&arguments.file, "")?;
    // As the tests do it: nobody else's realtime run meanwhile.
    let lock = hapfic_tests::hapfic().with_file_name("realtime-tests.lock");
    let lock = std::fs::OpenOptions::new().create(true).truncate(false).write(true).open(lock).expect("the tests' lock");
    flock(&lock, FlockOperation::LockExclusive).expect("the tests' lock");
    let before = machine::steal_ms();
    let (mut counts, mut speeds) = (LEGS.map(legs::Count::new), speed::WAYS.map(speed::Speed::new));
    // Round by round, so that what the machine does meanwhile falls on all alike.
    for round in 1..=arguments.rounds {
        for count in &mut counts {
            eprintln!("round {round} of {}: {} legs", arguments.rounds, count.legs);
            count.measure(arguments.seconds);
        }
        for speed in &mut speeds {
            eprintln!("round {round} of {}: {}", arguments.rounds, speed.way.name);
            speed.measure(arguments.seconds);
        }
    }
    let note = machine::note(&format!("scale {}", words.join(" ")), machine::steal_ms().saturating_sub(before));
    let text = fill(&arguments.file, &format!("{note}\n{}", tables::section(arguments, &counts, &speeds)))?;
    std::fs::write(&arguments.file, text).map_err(|error| format!("{}: cannot be written: {error}", arguments.file))?;
    Ok(counts
        .iter()
        .flat_map(|count| &count.shortfalls)
        .chain(speeds.iter().flat_map(|speed| &speed.shortfalls))
        .cloned()
        .collect())
}

/// The document with the tables in their place.
fn fill(file: &str, tables: &str) -> Result<String, String> {
    let text = std::fs::read_to_string(file).map_err(|error| format!("{file}: cannot be read: {error}"))?;
    if !document::has(&text, MARKER) {
        return Err(format!("{file}: found no line `<!-- {MARKER} -->`, expected one before the tables; add it"));
    }
    document::replace(&text, MARKER, tables).map_err(|error| format!("{file}: {error}"))
}
