//! The command line of `hapfic bench`.

use clap::{Args, Subcommand};
use std::path::PathBuf;

/// What to measure.
#[derive(Debug, Subcommand)]
pub enum Bench {
    /// The stack's own chain, hop by hop, beside chains over what the kernel offers, in the same milliseconds.
    Latency(LatencyArgs),
}

/// How to measure latencies.
#[derive(Args, Debug)]
pub struct LatencyArgs {
    /// Name of an embedded scenario, or path of a file.
    #[arg(default_value = "floor")]
    pub scenario: String,
    /// How long to measure, s, after a warm-up.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    pub seconds: u64,
    /// All figures as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// The distributions as a picture, PNG.
    #[arg(long, value_name = "FILE")]
    pub plot: Option<PathBuf>,
    /// A program with chains of its own, see the crate hapfic-diagnostics; may be given again.
    #[arg(long, value_name = "PROGRAM")]
    pub peers: Vec<PathBuf>,
    /// Keep every core busy meanwhile, with programs that are not real-time.
    #[arg(long)]
    pub load: bool,
    /// Replace a value of the scenario: `supervisor.standby=false`.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}
