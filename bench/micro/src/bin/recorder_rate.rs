//! Throughput of the recorder: messages at the rate of many legs, from shared memory into a file.
//!
//! One thread publishes, one drains every millisecond like the recorder, one encodes, accumulates metrics and writes.
//! The first measurement runs at the rate of one leg, for the recorder's share of a core; the second at a multiple of
//! it. Exit codes: 1 a message was lost, 2 the measurement failed.

use anyhow::{Context, Result};
use clap::Parser;
use hapfic_bench_micro::rate::{RateOptions, RateResult, measure};
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Sends the messages of many legs through shared memory into a file, and counts lost ones.
#[derive(Debug, Parser)]
struct Arguments {
    /// Length of each of the two measurements [s]
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=3600))]
    seconds: u32,
    /// Rate of the second measurement, as a multiple of one leg's (1 kHz)
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=200))]
    times: u32,
    /// Folder of the log, which is removed afterwards [default: a temporary folder]
    #[arg(long)]
    folder: Option<PathBuf>,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(e) => {
            // A closed stderr does not change the exit code.
            let _ = writeln!(std::io::stderr(), "hapfic-recorder-rate: {e:#}");
            ExitCode::from(2)
        }
    }
}

/// Runs both measurements. Returns whether no message was lost.
fn run(arguments: &Arguments) -> Result<bool> {
    let folder = match &arguments.folder {
        Some(folder) => tempfile::tempdir_in(folder).with_context(|| format!("cannot write in {}", folder.display()))?,
        None => tempfile::tempdir().context("cannot create a temporary folder")?,
    };
    let mut out = std::io::stdout();
    writeln!(
        out,
        "{:>6}  {:>10}  {:>8}  {:>8}  {:>8}  {:>7}  {:>7}",
        "rate", "messages/s", "MB/s", "on disk", "lost", "drain", "write"
    )?;
    let mut lost = 0;
    for times in [1, arguments.times] {
        let result = measure(&RateOptions { times, seconds: arguments.seconds, log: folder.path().join("rate.mcap") })?;
        lost += result.lost();
        let RateResult { received, message_bytes, file_bytes, wall_s, drain_s, write_s, .. } = result;
        let share = |cpu_s: f64| 100.0 * cpu_s / wall_s;
        writeln!(
            out,
            "{times:>4} x  {:>10.0}  {:>8.2}  {:>8.2}  {:>8}  {:>5.1} %  {:>5.1} %",
            received as f64 / wall_s,
            message_bytes as f64 / 1e6 / wall_s,
            file_bytes as f64 / 1e6 / wall_s,
            result.lost(),
            share(drain_s),
            share(write_s)
        )?;
    }
    let verdict = if lost == 0 { "no message was lost" } else { "messages were lost" };
    writeln!(out, "{} x the rate of one leg for {} s: {verdict}", arguments.times, arguments.seconds)?;
    Ok(lost == 0)
}
