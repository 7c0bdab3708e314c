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

use crate::CommandOutcome;
use crate::commands::run::RunArgs;
use anyhow::{Context, Result};
use std::time::Instant;

/// Runs a measurement.
pub fn bench(what: &Bench) -> Result<CommandOutcome> {
    match what {
        Bench::Latency(args) => latency::latency(args),
    }
}

/// Runs `hapfic bench-chain`: a driver or relay of a chain over a transport of the kernel.
pub fn chain(arguments: &[String]) -> Result<CommandOutcome> {
    Ok(match hapfic_diagnostics::program(&[chains::CHAIN_COMMAND], arguments, &hapfic_diagnostics::kernel_kinds()) {
        Ok(()) => CommandOutcome::Done,
        Err(e) => CommandOutcome::Rejected(e.into()),
    })
}

/// Runs `hapfic bench-run`: a run that ends with the measurement.
pub fn run(parent: i32, args: &RunArgs, since: Instant) -> Result<CommandOutcome> {
    hapfic_ipc::tie_to_parent(parent).context("cannot join the measurement")?;
    super::run::run(args, since)
}
