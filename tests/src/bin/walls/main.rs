//! Makes the tables of `docs/walls.md`: the held force on walls of every stiffness and damping, with three laws, the loss
//! of contact, and the margins against dead time and mass.
//!
//! `walls DOCUMENT` simulates all cases in one process, which gives the same messages as lockstep, and writes each table
//! into the document between its marker and the next `<!-- end -->`. It ends with 1 and a line for each case of the
//! default law beyond its limits, and with 2 after a bad file. Without a document it only checks the default law.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr)]

mod case;
#[path = "../experiments/document.rs"]
mod document;
mod loss;
mod margins;
mod outcome;
mod table;

use case::{Case, LAWS};
use outcome::Outcome;
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let made = match (arguments.next(), arguments.next()) {
        (None, None) => simulate(&Case::all(LAWS[0])).map(|results| table::shortfalls(&results)),
        (Some(file), None) => make(&file),
        _ => {
            eprintln!("walls: expected at most one argument, the document with the tables, as in `walls docs/walls.md`");
            return ExitCode::from(2);
        }
    };
    match made {
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

/// Simulates everything and writes the tables. Returns the cases beyond their limits.
fn make(file: &str) -> Result<Vec<String>, String> {
    let read = || std::fs::read_to_string(file).map_err(|error| format!("{file}: cannot be read: {error}"));
    let fill = |mut text: String, tables: [&str; 5]| {
        for (name, table) in ["walls", "between", "laws", "loss", "margins"].into_iter().zip(tables) {
            text = document::replace(&text, name, table).map_err(|error| format!("{file}: {error}"))?;
        }
        Ok::<_, String>(text)
    };
    // Checks all markers before minutes of runs.
    let before = read()?;
    if !document::has_marker(&before, "walls") {
        return Err(format!("{file}: found no line `<!-- walls -->`, expected one before that table"));
    }
    fill(before, [""; 5])?;
    let results: Vec<Vec<(Case, Outcome)>> = LAWS.into_iter().map(|law| simulate(&Case::all(law))).collect::<Result<_, _>>()?;
    let between = table::between(&simulate(&Case::between(LAWS[0]))?);
    let (loss, margins) = (loss::table()?, margins::table()?);
    let text = fill(read()?, [&table::walls(&results[0]), &between, &table::laws(&results), &loss, &margins])?;
    std::fs::write(file, text).map_err(|error| format!("{file}: cannot be written: {error}"))?;
    Ok(table::shortfalls(&results[0]))
}

/// Simulates cases on all processors, in order.
fn simulate(cases: &[Case]) -> Result<Vec<(Case, Outcome)>, String> {
    let mut outcomes = Vec::new();
    let jobs = std::thread::available_parallelism().map_or(1, usize::from);
    let work = |index: usize| Some(outcome::outcome(&cases[index]));
    hapfic_simulation::pool::in_order(cases.len(), jobs, &AtomicBool::new(false), work, |_, outcome| {
        outcomes.push(outcome);
        Ok(())
    })
    .map_err(|error| error.to_string())?;
    cases.iter().copied().zip(outcomes).map(|(case, outcome)| Ok((case, outcome?))).collect()
}
