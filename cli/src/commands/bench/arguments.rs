//! The command line of `hapfic bench`.

use clap::{Args, Subcommand};
use std::path::PathBuf;

/// Measurements of `hapfic bench`.
#[derive(Debug, Subcommand)]
pub enum Bench {
    /// Measure the stack's chain hop by hop, interleaved with chains over transports of the kernel.
    Latency(LatencyArgs),
}

/// Arguments of `hapfic bench latency`.
#[derive(Args, Debug)]
pub struct LatencyArgs {
    /// Name of an embedded scenario, or path of a file.
    #[arg(default_value = "floor")]
    pub scenario: String,
    /// Duration of the measurement after a warm-up [s].
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub seconds: u64,
    /// File for all results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// File for the latency histograms as PNG.
    #[arg(long, value_name = "FILE")]
    pub plot: Option<PathBuf>,
    /// Replace output files of another kind.
    #[arg(long)]
    pub force: bool,
    /// Program with chains of its own, see the crate hapfic-diagnostics; may be given repeatedly.
    #[arg(long, value_name = "PROGRAM")]
    pub peers: Vec<PathBuf>,
    /// Keep every core busy during the measurement, with processes that are not real-time.
    #[arg(long)]
    pub load: bool,
    /// Replace a value of the scenario: `supervisor.standby=false`.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}
