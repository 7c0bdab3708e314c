//! `hapfic bench`: measurements of this machine, and of the stack on it.

mod arguments;
mod chains;
mod figure;
mod latency;
mod load;
mod output_paths;
mod results;
mod stack;
mod steal;
mod table;
mod ticks;

pub use arguments::Bench;

use crate::Outcome;
use crate::commands::run::RunArgs;
use anyhow::{Context, Result};
use std::time::Instant;

/// Runs a measurement.
pub fn bench(what: &Bench) -> Result<Outcome> {
    match what {
        Bench::Latency(args) => latency::latency(args),
    }
}

/// Runs `hapfic bench-chain`: a driver or relay of a chain over a transport of the kernel.
pub fn chain(words: &[String]) -> Result<Outcome> {
    Ok(match hapfic_diagnostics::program(&[chains::CHAIN_COMMAND], words, &hapfic_diagnostics::own()) {
        Ok(()) => Outcome::Done,
        Err(e) => Outcome::Rejected(e.into()),
    })
}

/// Runs `hapfic bench-run`: a run that ends with the measurement.
pub fn run(parent: i32, args: &RunArgs, since: Instant) -> Result<Outcome> {
    hapfic_ipc::tie_to_supervisor(parent, hapfic_ipc::Ending::Asked).context("cannot join the measurement")?;
    super::run::run(args, since)
}
