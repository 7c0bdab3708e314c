//! Makes the tables of `docs/experiments.md`: the floor over a range of desired forces with each law, and all
//! scenarios.
//!
//! `experiments FILE...` writes each table into the files with its marker, such as `<!-- floor -->`, between it and the
//! next `<!-- end -->`. Every row is a lockstep run of the real stack, so the same command gives the same tables on
//! every machine of the same kind. After all tables it checks the limits of the defaults, and ends with 1 and a line
//! for each shortfall. It ends with 2 after a bad file.
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
    let files: Vec<String> = std::env::args().skip(1).collect();
    if files.is_empty() {
        eprintln!(
            "experiments: found no argument, expected the files with the tables; run it as `experiments docs/experiments.md README.md`"
        );
        return ExitCode::from(2);
    }
    match make(&files) {
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

/// Runs everything and writes all tables. Returns the shortfalls.
fn make(files: &[String]) -> Result<Vec<String>, String> {
    let read = |file: &String| std::fs::read_to_string(file).map_err(|error| format!("{file}: cannot be read: {error}"));
    let fill = |file: &String, mut text: String, table: &dyn Fn(usize) -> String| {
        for (index, (name, _)) in tables::TABLES.iter().enumerate() {
            if document::has_marker(&text, name) {
                text = document::replace(&text, name, &table(index)).map_err(|error| format!("{file}: {error}"))?;
            }
        }
        Ok::<_, String>(text)
    };
    // Checks all markers before minutes of runs.
    let texts = files.iter().map(read).collect::<Result<Vec<_>, _>>()?;
    for (name, _) in tables::TABLES {
        if !texts.iter().any(|text| document::has_marker(text, name)) {
            return Err(format!("{}: found no line `<!-- {name} -->`, expected one before that table", files.join(", ")));
        }
    }
    files.iter().zip(texts).try_for_each(|(file, text)| fill(file, text, &|_| String::new()).map(|_| ()))?;

    let results = runs::all();
    let shortfalls = verdict::shortfalls(&results);
    if !runs::complete(&results) {
        // Figures of an incomplete run would look like valid ones.
        return Ok(shortfalls);
    }
    let tables: Vec<String> = tables::TABLES.iter().map(|(_, table)| table(&results)).collect();
    for file in files {
        // Reads the file again, since it may have changed meanwhile.
        let text = fill(file, read(file)?, &|index| tables[index].clone())?;
        std::fs::write(file, text).map_err(|error| format!("{file}: cannot be written: {error}"))?;
    }
    Ok(shortfalls)
}
