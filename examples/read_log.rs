//! Reads the log of a run: the largest contact force on each axis, and the last tick.
//!
//! ```sh
//! cargo run --release -- run floor --clock lockstep --log floor.mcap
//! cargo run --release -p hapfic-examples --bin read_log -- floor.mcap
//! ```
#![allow(clippy::print_stdout, clippy::print_stderr)]

use hapfic_log::{LogError, Reader, Record};
use std::process::ExitCode;

fn main() -> ExitCode {
    let Some(path) = std::env::args_os().nth(1) else {
        eprintln!("usage: read_log LOG.mcap");
        return ExitCode::from(2);
    };
    match read(path.as_ref()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("read_log: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Reads a log once, with one chunk in memory at a time, and prints its figures, also if it ends in an error.
fn read(path: &std::path::Path) -> Result<(), LogError> {
    let (mut largest, mut last_tick) = ([0.0_f64; 3], None);
    let mut problem = None;
    for entry in Reader::open(path)? {
        match entry {
            // Measurements of the plant at a tick; the other topics are requests, commands, events and timing.
            Ok(entry) => {
                if let Record::State(state) = entry.record {
                    for (largest, force) in largest.iter_mut().zip(&state.foot_force) {
                        *largest = largest.max(force.abs());
                    }
                    last_tick = Some(state.tick);
                }
            }
            // A truncated log yields all its whole messages first, then one error, and ends.
            Err(error) => problem = Some(error),
        }
    }
    let [x, y, z] = largest;
    println!("largest force on the foot: x {x:.1} N, y {y:.1} N, z {z:.1} N");
    match last_tick {
        Some(tick) => println!("last tick: {tick}"),
        None => println!("no tick: the log has no state"),
    }
    problem.map_or(Ok(()), Err)
}
