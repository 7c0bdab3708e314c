//! Makes the tables of `docs/faults.md`: the reaction of the real stack to injected faults.
//!
//! `faults FILE` makes four parts: the matrix of processes, faults and phases; kills of the supervisor; many faults in
//! a few minutes; rejected messages. It writes each part, once complete, between its markers, such as `<!-- soak -->`,
//! and the next `<!-- end -->`. It ends with 1 and a line for each figure that fell short, and with 2 after a bad
//! command line or file.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr)]

#[path = "faults/arguments.rs"]
mod arguments;
#[path = "experiments/document.rs"]
mod document;
#[path = "faults/lockstep.rs"]
mod lockstep;
#[path = "faults/machine.rs"]
mod machine;
#[path = "faults/matrix.rs"]
mod matrix;
#[path = "faults/moment.rs"]
mod moment;
#[path = "faults/orphans.rs"]
mod orphans;
#[path = "faults/part.rs"]
mod part;
#[path = "faults/realtime.rs"]
mod realtime;
#[path = "faults/refusals.rs"]
mod refusals;
#[path = "faults/runs.rs"]
mod runs;
#[path = "faults/sample.rs"]
mod sample;
#[path = "faults/soak.rs"]
mod soak;
#[path = "faults/trace.rs"]
mod trace;

use arguments::{Arguments, PartName};
use part::{DocumentPart, Expectation};
use rustix::fs::{FlockOperation, flock};
use std::process::ExitCode;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let arguments = match Arguments::read(&words) {
        Ok(arguments) => arguments,
        Err(error) => {
            eprintln!("{error}");
            return ExitCode::from(2);
        }
    };
    match make(&arguments, &words) {
        Ok(shortfalls) if shortfalls.is_empty() => ExitCode::SUCCESS,
        Ok(shortfalls) => {
            for fell in &shortfalls {
                eprintln!("fell short: {}: found {}, expected {}", fell.what, fell.found, fell.expected);
            }
            ExitCode::FAILURE
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(2)
        }
    }
}

/// Makes the requested parts. Returns the expectations that fell short.
fn make(arguments: &Arguments, words: &[String]) -> Result<Vec<Expectation>, String> {
    // Checks all markers before an hour of runs.
    for which in &arguments.parts {
        let empty = which.markers().iter().map(|marker| (*marker, String::new())).collect();
        fill(&arguments.file, &DocumentPart { tables: empty, expectations: Vec::new() }, "")?;
    }
    // One realtime run at a time, as in the tests.
    let lock = hapfic_tests::hapfic().with_file_name("realtime-tests.lock");
    let lock = std::fs::OpenOptions::new().create(true).truncate(false).write(true).open(lock).expect("the tests' lock");
    flock(&lock, FlockOperation::LockExclusive).expect("the tests' lock");
    let mut shortfalls = Vec::new();
    for which in &arguments.parts {
        let before = machine::steal_ms();
        let part = match which {
            PartName::Matrix => matrix::make(arguments.quick),
            PartName::Supervisor => orphans::make(arguments.quick),
            PartName::Soak => soak::make(arguments.minutes),
            PartName::Rejections => refusals::make(),
        };
        let note = machine::note(&format!("faults {}", words.join(" ")), machine::steal_ms().saturating_sub(before));
        let text = fill(&arguments.file, &part, &note)?;
        std::fs::write(&arguments.file, text).map_err(|error| format!("{}: cannot be written: {error}", arguments.file))?;
        shortfalls.extend(part.expectations.into_iter().filter(|expectation| !expectation.reached));
    }
    Ok(shortfalls)
}

/// Returns the document with the tables of a part. The first table has a note on machine and date.
fn fill(file: &str, part: &DocumentPart, note: &str) -> Result<String, String> {
    let mut text = std::fs::read_to_string(file).map_err(|error| format!("{file}: cannot be read: {error}"))?;
    for (index, (marker, table)) in part.tables.iter().enumerate() {
        let table = if index == 0 && !note.is_empty() { format!("{note}\n{table}") } else { table.clone() };
        if !document::has_marker(&text, marker) {
            return Err(format!("{file}: found no line `<!-- {marker} -->`, expected one before that table; add it"));
        }
        text = document::replace(&text, marker, &table).map_err(|error| format!("{file}: {error}"))?;
    }
    Ok(text)
}
