//! Makes the tables of `docs/performance.md` on scaling: legs per machine, and simulation speed.
//!
//! `scale FILE` runs one, two, four and eight independent realtime stacks side by side, and measures their resources
//! and missed ticks. Then it measures the speed of lockstep, with processes and in one process. It writes the tables
//! between the lines `<!-- scale -->` and `<!-- end -->`. It ends with 1 and a line for each incomplete run, and with 2
//! after a bad command line or file.
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

/// Marker of the tables.
const MARKER: &str = "scale";
/// Numbers of simultaneous stacks.
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

/// Measures everything and writes the tables. Returns the shortfalls.
fn make(arguments: &Arguments, words: &[String]) -> Result<Vec<String>, String> {
    // Checks the marker before minutes of runs.
    fill(&arguments.file, "")?;
    // No other realtime run meanwhile, as in the tests.
    let lock = hapfic_tests::hapfic().with_file_name("realtime-tests.lock");
    let lock = std::fs::OpenOptions::new().create(true).truncate(false).write(true).open(lock).expect("the tests' lock");
    flock(&lock, FlockOperation::LockExclusive).expect("the tests' lock");
    let before = machine::steal_ms();
    let (mut counts, mut speeds) = (LEGS.map(legs::LegCount::new), speed::MODES.map(speed::SpeedResult::new));
    // Round by round, so other load of the machine affects all alike.
    for round in 1..=arguments.rounds {
        for count in &mut counts {
            eprintln!("round {round} of {}: {} legs", arguments.rounds, count.legs);
            count.measure(arguments.seconds);
        }
        for speed in &mut speeds {
            eprintln!("round {round} of {}: {}", arguments.rounds, speed.mode.name);
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

/// Returns the document with the new tables.
fn fill(file: &str, tables: &str) -> Result<String, String> {
    let text = std::fs::read_to_string(file).map_err(|error| format!("{file}: cannot be read: {error}"))?;
    if !document::has_marker(&text, MARKER) {
        return Err(format!("{file}: found no line `<!-- {MARKER} -->`, expected one before the tables; add it"));
    }
    document::replace(&text, MARKER, tables).map_err(|error| format!("{file}: {error}"))
}
