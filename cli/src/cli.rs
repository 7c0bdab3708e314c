//! The command line.

use crate::commands::bench::Bench;
use crate::commands::calibrate::CalibrateArgs;
use crate::commands::cross_check::CrossCheckArgs;
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
    /// Command; `run floor` if none is given.
    #[command(subcommand)]
    pub command: Option<CliCommand>,
}

/// Commands of the program.
#[derive(Debug, Subcommand)]
pub enum CliCommand {
    /// Run a scenario: launch all processes, log everything, print a summary.
    Run(RunArgs),
    /// Simulate a scenario in one process, without a clock: one run, or a study over parameter values.
    Simulate(SimulateArgs),
    /// Check a scenario file, its robot and the files that they name, without running it; warn of what is valid but
    /// unwise.
    Check {
        /// Name of an embedded scenario, or path of a file.
        scenario: String,
        /// Replace a value: `controller.taper=0.1`, `operator.2.desired_force=[0, 0, 80]`.
        #[arg(long = "set", value_name = "KEY=VALUE")]
        set: Vec<String>,
    },
    /// Simulate scenarios in both physics engines, and print what came out side by side.
    CrossCheck(CrossCheckArgs),
    /// Find gains that a robot bears: print a [controller] section with reasons, verified by short simulations.
    Calibrate(CalibrateArgs),
    /// List the embedded scenarios, or print the file of one.
    Scenarios {
        /// Scenario to print, as a start for your own.
        name: Option<String>,
    },
    /// Print the JSON Schema of scenario files, for editors; or the messages, for programs in other languages.
    Schema {
        /// The layouts of the messages, the meanings of the codes, and the topics, in a language.
        #[arg(long, value_name = "LANGUAGE")]
        messages: Option<Language>,
    },
    /// Change parameters of a running stack: all of one command take effect together, at one tick on all processes. The
    /// answer warns of what is unwise, and a dangerous change needs --force.
    Set {
        /// Name of the run, as in `status`; not needed while only one is running.
        #[arg(long)]
        run: Option<String>,
        /// Make a dangerous change all the same: gains that oscillate, a force or a target beyond what the law can hold.
        #[arg(long, conflicts_with = "dry_run")]
        force: bool,
        /// Show old and new values and all warnings, and change nothing.
        #[arg(long)]
        dry_run: bool,
        /// Parameters to change, as in an operator entry: `desired_force=[0,0,80]`, `stiffness.z=9000`.
        #[arg(required = true, value_name = "KEY=VALUE")]
        changes: Vec<String>,
    },
    /// Print the parameters in force in a running stack, as `key = value` lines that `set` accepts.
    Get {
        /// Name of the run, as in `status`; not needed while only one is running.
        #[arg(long)]
        run: Option<String>,
        /// Print one JSON object, for scripts.
        #[arg(long)]
        json: bool,
        /// Parameters to print, as `stiffness` or `desired_force.z`; all if none is given.
        #[arg(value_name = "KEY")]
        keys: Vec<String>,
    },
    /// Show the status of a running stack.
    Status {
        /// Name of the run; not needed while only one is running.
        #[arg(long)]
        run: Option<String>,
        /// Print one JSON object, for scripts.
        #[arg(long)]
        json: bool,
        /// Print once instead of following the run.
        #[arg(long)]
        once: bool,
    },
    /// End a running stack, and close its log as Ctrl-C does.
    Stop {
        /// Name of the run; not needed while only one is running.
        #[arg(long)]
        run: Option<String>,
    },
    /// Latch a stop of a running stack: the drive brakes from the next tick until `rearm`.
    Estop {
        /// Name of the run; not needed while only one is running.
        #[arg(long)]
        run: Option<String>,
    },
    /// Leave a latched stop: start from the foot's present position, and ramp the torque in.
    Rearm {
        /// Name of the run; not needed while only one is running.
        #[arg(long)]
        run: Option<String>,
    },
    /// Inject a fault into a running stack: `kind=kill process=controller`, `kind=stop process=planner for_ms=50`.
    Inject {
        /// Name of the run, as in `status`; not needed while only one is running.
        #[arg(long)]
        run: Option<String>,
        /// Fault to inject, as in a scenario's `[[fault]]` entry.
        #[arg(required = true, value_name = "KEY=VALUE")]
        fault: Vec<String>,
    },
    /// Examine whether this machine is good enough for 1 kHz: its properties, a measurement, one verdict, and what to
    /// change.
    Doctor {
        /// Duration of the measurement, 1 to 3600 [s].
        #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=3600))]
        seconds: u32,
        /// Print one JSON object, for scripts.
        #[arg(long)]
        json: bool,
    },
    /// Print the parameter sets of a log as entries of a scenario, to replay them.
    Timeline {
        /// Log of `hapfic run`.
        log: PathBuf,
    },
    /// Draw the figures of a log, and summarise it.
    Report(ReportArgs),
    /// Measure this machine, and the stack on it.
    Bench {
        /// Measurement.
        #[command(subcommand)]
        what: Bench,
    },
    /// Run a chain of the comparison; `bench latency` starts it.
    #[command(hide = true)]
    BenchChain {
        /// Arguments of a program of hapfic-diagnostics.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        words: Vec<String>,
    },
    /// Run a scenario until the measurement ends; `bench latency` starts it.
    #[command(hide = true)]
    BenchRun {
        /// Process id of the measurement.
        parent: i32,
        /// Arguments of the run.
        #[command(flatten)]
        run: RunArgs,
    },
    /// Make a readable copy of a truncated or damaged log; the original is kept.
    Recover {
        /// Damaged log.
        log: PathBuf,
        /// Path of the recovered log; `NAME.recovered.mcap` beside the original if not given.
        #[arg(long, value_name = "FILE")]
        output: Option<PathBuf>,
    },
    /// Stress the machine; the supervisor starts this for an injected fault.
    #[command(hide = true)]
    Stressor {
        /// Process id of the supervisor.
        supervisor: i32,
        /// Kind of stress, and its arguments.
        what: Vec<String>,
    },
    /// Run one process of a stack; launcher and supervisor start it.
    #[command(hide = true)]
    Process {
        /// Role of the process.
        name: ProcessName,
        /// Program of an external process, and its arguments.
        #[arg(last = true)]
        external: Vec<String>,
    },
}

/// Language of the layouts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Language {
    /// Data for any program.
    Json,
    /// A module of `ctypes` structures.
    Python,
    /// A header with static assertions.
    C,
}
