//! The command line.

use crate::commands::bench::Bench;
use crate::commands::process::ProcessName;
use crate::commands::report::ReportArgs;
use crate::commands::run::RunArgs;
use crate::commands::simulate::SimulateArgs;
use clap::{Parser, Subcommand};
use std::path::PathBuf;

/// A real-time control stack for robots that touch things: the HapFIC adaptive force/position controller.
#[derive(Debug, Parser)]
#[command(name = "hapfic", version, propagate_version = true)]
pub struct Cli {
    /// What to do; `run floor` if nothing is given.
    #[command(subcommand)]
    pub command: Option<Command>,
}

/// What the program can do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a scenario: launch all processes, log everything, print a summary.
    Run(RunArgs),
    /// Simulate a scenario in one process, without a clock: one run, or a study over values of settings.
    Simulate(SimulateArgs),
    /// Check a scenario file, its robot and everything they name, without running it.
    Check {
        /// Name of an embedded scenario, or path of a file.
        scenario: String,
        /// Replace a value: `controller.taper=0.1`, `operator.2.desired_force=[0, 0, 80]`.
        #[arg(long = "set", value_name = "KEY=VALUE")]
        set: Vec<String>,
    },
    /// List the embedded scenarios; with a name, print its file.
    Scenarios {
        /// Scenario to print, as a start for one of your own.
        name: Option<String>,
    },
    /// Print the JSON Schema of scenario files, for editors.
    Schema,
    /// Change parameters of a running stack: all of one command take effect together, at one tick on all processes.
    Set {
        /// The run, as `status` names it; not needed while only one is running.
        #[arg(long)]
        run: Option<String>,
        /// What to change, as in an operator's entry: `desired_force=[0,0,80]`, `stiffness.z=9000`.
        #[arg(required = true, value_name = "KEY=VALUE")]
        changes: Vec<String>,
    },
    /// Show how a running stack is doing.
    Status {
        /// The run; not needed while only one is running.
        #[arg(long)]
        run: Option<String>,
        /// One JSON object, for scripts.
        #[arg(long)]
        json: bool,
        /// Print once instead of following the run.
        #[arg(long)]
        once: bool,
    },
    /// End a running stack; its log is closed as after Ctrl-C.
    Stop {
        /// The run; not needed while only one is running.
        #[arg(long)]
        run: Option<String>,
    },
    /// Latched stop of a running stack: the drive brakes at the next tick, until `rearm`.
    Estop {
        /// The run; not needed while only one is running.
        #[arg(long)]
        run: Option<String>,
    },
    /// Leave a latched stop: starts from where the foot is, and ramps the torque in.
    Rearm {
        /// The run; not needed while only one is running.
        #[arg(long)]
        run: Option<String>,
    },
    /// Make a fault on purpose in a running stack: `kind=kill process=controller`, `kind=stop process=planner for_ms=50`.
    Inject {
        /// The run, as `status` names it; not needed while only one is running.
        #[arg(long)]
        run: Option<String>,
        /// What to do, as in a scenario's `[[fault]]` entry.
        #[arg(required = true, value_name = "KEY=VALUE")]
        fault: Vec<String>,
    },
    /// Say whether this machine is good enough for 1 kHz, and what to change: what it says of itself, a measurement, one verdict.
    Doctor {
        /// How long to measure, s, 1 to 3600.
        #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=3600))]
        seconds: u32,
        /// One JSON object, for scripts.
        #[arg(long)]
        json: bool,
    },
    /// Print what the operator did in a log as entries of a scenario, to replay it.
    Timeline {
        /// A log of `hapfic run`.
        log: PathBuf,
    },
    /// Draw the figures of a log and sum it up.
    Report(ReportArgs),
    /// Measure this machine, and the stack on it.
    Bench {
        /// What to measure.
        #[command(subcommand)]
        what: Bench,
    },
    /// A chain beside the stack's own; started by `bench latency`.
    #[command(hide = true)]
    BenchChain {
        /// As hapfic-diagnostics understands them.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        words: Vec<String>,
    },
    /// A run that ends with a measurement; started by `bench latency`.
    #[command(hide = true)]
    BenchRun {
        /// Process id of the measurement.
        parent: i32,
        /// How to run.
        #[command(flatten)]
        run: RunArgs,
    },
    /// Make a log that was cut off or damaged readable again; the original is kept.
    Recover {
        /// The damaged log.
        log: PathBuf,
        /// Where to write the recovered one; `NAME.recovered.mcap` beside it if not given.
        #[arg(long, value_name = "FILE")]
        output: Option<PathBuf>,
    },
    /// Something in everybody's way; started by the supervisor for a fault on purpose.
    #[command(hide = true)]
    Nuisance {
        /// Process id of the supervisor.
        supervisor: i32,
        /// What to do.
        what: Vec<String>,
    },
    /// One process of a running stack; started by the supervisor.
    #[command(hide = true)]
    Process {
        /// Which one.
        name: ProcessName,
        /// A foreign program to become, and its arguments.
        #[arg(last = true)]
        foreign: Vec<String>,
    },
}
