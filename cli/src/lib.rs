//! The program `hapfic`: command line, and exit codes.
//!
//! | exit code | meaning |
//! |---|---|
//! | 0 | done; a run completed |
//! | 1 | `hapfic doctor`: the machine is not good enough |
//! | 2 | the input is invalid; nothing was started |
//! | 3 | the run failed |

mod cli;
mod commands;

use clap::Parser;
use hapfic_messages::OperatorKind;
use hapfic_supervisor::log_line;
use std::io::Write;
use std::process::ExitCode;
use std::time::Instant;

/// Exit code: the machine is not good enough.
const NOT_GOOD_ENOUGH: u8 = 1;
/// Exit code: the input is invalid.
const INVALID_INPUT: u8 = 2;
/// Exit code: the run failed.
const FAILED: u8 = 3;

/// Runs the command of the command line.
pub fn main() -> ExitCode {
    let since = Instant::now();
    let cli = cli::Cli::parse();
    let outcome = match cli.command.unwrap_or_else(|| cli::Command::Run(commands::run::RunArgs::default())) {
        cli::Command::Run(args) => commands::run::run(&args, since),
        cli::Command::Simulate(args) => commands::simulate::simulate(&args),
        cli::Command::Check { scenario, set } => commands::check::check(&scenario, &set),
        cli::Command::Scenarios { name } => commands::scenarios::scenarios(name.as_deref()),
        cli::Command::Schema => {
            print(&hapfic_config::json_schema());
            Ok(Outcome::Done)
        }
        cli::Command::Set { run, changes } => commands::control::request(run.as_deref(), OperatorKind::Set, &changes),
        cli::Command::Status { run, json, once } => commands::status::status(run.as_deref(), json, once),
        cli::Command::Stop { run } => commands::stop::stop(run.as_deref()),
        cli::Command::Estop { run } => commands::control::request(run.as_deref(), OperatorKind::EmergencyStop, &[]),
        cli::Command::Rearm { run } => commands::control::request(run.as_deref(), OperatorKind::Rearm, &[]),
        cli::Command::Inject { run, fault } => commands::control::request(run.as_deref(), OperatorKind::Inject, &fault),
        cli::Command::Stressor { supervisor, what } => commands::stressor::stressor(supervisor, &what),
        cli::Command::Doctor { seconds, json } => commands::doctor::doctor(seconds, json),
        cli::Command::Bench { what } => commands::bench::bench(&what),
        cli::Command::BenchChain { words } => commands::bench::chain(&words),
        cli::Command::BenchRun { parent, run } => commands::bench::run(parent, &run, since),
        cli::Command::Timeline { log } => commands::timeline::timeline(&log),
        cli::Command::Report(args) => commands::report::report(&args),
        cli::Command::Recover { log, output } => commands::recover::recover(&log, output.as_deref()),
        cli::Command::Process { name, external } => commands::process::process(name, &external),
    };
    match outcome {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::NotGoodEnough) => ExitCode::from(NOT_GOOD_ENOUGH),
        Ok(Outcome::Failed) => ExitCode::from(FAILED),
        Ok(Outcome::Rejected(e)) => {
            log_line(&format!("hapfic: {e:#}"));
            ExitCode::from(INVALID_INPUT)
        }
        Err(e) => {
            log_line(&format!("hapfic: {e:#}"));
            ExitCode::from(FAILED)
        }
    }
}

/// Result of a command.
enum Outcome {
    /// The command did as requested.
    Done,
    /// The machine is not good enough for 1 kHz; the reasons are printed.
    NotGoodEnough,
    /// The run failed; the reasons are printed.
    Failed,
    /// The input is invalid.
    Rejected(anyhow::Error),
}

/// Writes a line to standard output; a closed standard output is no failure.
fn print(text: &str) {
    let _ = writeln!(std::io::stdout(), "{text}");
}
