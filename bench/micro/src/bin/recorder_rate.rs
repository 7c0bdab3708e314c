//! Whether the recorder keeps up: messages of many legs' rate through shared memory into a file, none lost.
//!
//! One thread publishes, one drains every millisecond as the recorder's does, one encodes, sums up and writes. First at the rate
//! of one leg, for the recorder's share of a core; then at a multiple of it. Exit codes: 1 a message was lost, 2 it could not be
//! measured.

use anyhow::{Context, Result};
use clap::Parser;
use hapfic_bench_micro::rate::{Outcome, SchedRequest, measure};
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Puts many legs' messages through shared memory into a file, and counts what is lost.
#[derive(Debug, Parser)]
struct Arguments {
    /// Length of each of the two measurements, s
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=3600))]
    seconds: u32,
    /// Rate of the second one, in rates of one leg (1 kHz)
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=200))]
    times: u32,
    /// Where the log is written; removed afterwards [default: a temporary folder]
    #[arg(long)]
    folder: Option<PathBuf>,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(e) => {
            // Nobody to tell is no reason to fail differently.
            let _ = writeln!(std::io::stderr(), "hapfic-recorder-rate: {e:#}");
            ExitCode::from(2)
        }
    }
}

/// Measures; says whether nothing was lost.
fn run(arguments: &Arguments) -> Result<bool> {
    let folder = match &arguments.folder {
        Some(folder) => tempfile::tempdir_in(folder).with_context(|| format!("cannot write in {}", folder.display()))?,
        None => tempfile::tempdir().context("cannot make a temporary folder")?,
    };
    let mut out = std::io::stdout();
    writeln!(
        out,
        "{:>6}  {:>10}  {:>8}  {:>8}  {:>8}  {:>7}  {:>7}",
        "rate", "messages/s", "MB/s", "on disk", "lost", "drain", "write"
    )?;
    let mut lost = 0;
    for times in [1, arguments.times] {
        let outcome = measure(&SchedRequest { times, seconds: arguments.seconds, log: folder.path().join("rate.mcap") })?;
        lost += outcome.lost();
        let Outcome { received, message_bytes, file_bytes, wall_s, drain_s, write_s, .. } = outcome;
        let share = |cpu_s: f64| 100.0 * cpu_s / wall_s;
        writeln!(
            out,
            "{times:>4} x  {:>10.0}  {:>8.2}  {:>8.2}  {:>8}  {:>5.1} %  {:>5.1} %",
            received as f64 / wall_s,
            message_bytes as f64 / 1e6 / wall_s,
            file_bytes as f64 / 1e6 / wall_s,
            outcome.lost(),
            share(drain_s),
            share(write_s)
        )?;
    }
    let verdict = if lost == 0 { "nothing was lost" } else { "messages were lost" };
    writeln!(out, "{} x the rate of one leg for {} s: {verdict}", arguments.times, arguments.seconds)?;
    Ok(lost == 0)
}
