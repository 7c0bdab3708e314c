//! Makes the tables of `docs/experiments.md`: the floor over a range of wished forces with each law, and all scenarios.
//!
//! `experiments FILE` writes each table into the file, between its marker, such as `<!-- floor -->`, and the next
//! `<!-- end -->`. Every row is a lockstep run of the real stack, so the same command gives the same tables on every machine of
//! the same kind. What the defaults must reach is checked after all tables are written: it then ends with 1 and says what fell
//! short. It ends with 2 if the file is not as it must be.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr)]

#[path = "experiments/changes.rs"]
mod changes;
#[path = "experiments/document.rs"]
mod document;
#[path = "experiments/figures.rs"]
mod figures;
#[path = "experiments/runs.rs"]
mod runs;
#[path = "experiments/tables.rs"]
mod tables;
#[path = "experiments/verdict.rs"]
mod verdict;

use std::process::ExitCode;

fn main() -> ExitCode {
    let Some(file) = std::env::args().nth(1) else {
        eprintln!(
            "experiments: found no argument, expected the file with the tables; run it as `experiments docs/experiments.md`"
        );
        return ExitCode::from(2);
    };
    match make(&file) {
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

/// Runs everything and writes all tables. Returns what fell short.
fn make(file: &str) -> Result<Vec<String>, String> {
    let read = || std::fs::read_to_string(file).map_err(|error| format!("{file}: cannot be read: {error}"));
    // Before minutes of running: all places are there.
    let names = tables::TABLES.map(|(name, _)| name);
    let text = read()?;
    names.iter().try_fold(text, |text, name| document::replace(&text, name, "")).map_err(|error| format!("{file}: {error}"))?;

    let results = runs::all();
    // Anew: the file may have been edited meanwhile.
    let mut text = read()?;
    for (name, table) in tables::TABLES {
        text = document::replace(&text, name, &table(&results)).map_err(|error| format!("{file}: {error}"))?;
    }
    std::fs::write(file, text).map_err(|error| format!("{file}: cannot be written: {error}"))?;
    Ok(verdict::shortfalls(&results))
}
