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
mod output;

use clap::Parser;
use hapfic_messages::OperatorKind;
use hapfic_supervisor::log_line;
use std::io::Write;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Exit code: the machine, or what was found for a robot, is not good enough.
const NOT_GOOD_ENOUGH: u8 = 1;
/// Exit code: the input is invalid.
const INVALID_INPUT: u8 = 2;
/// Exit code: the run failed.
const FAILED: u8 = 3;

/// Runs the command of the command line.
pub fn main() -> ExitCode {
    let since = Instant::now();
    let cli = cli::Cli::parse();
    let outcome = match cli.command.unwrap_or_else(|| cli::CliCommand::Run(commands::run::RunArgs::default())) {
        cli::CliCommand::Run(args) => commands::run::run(&args, since),
        cli::CliCommand::Simulate(args) => commands::simulate::simulate(&args),
        cli::CliCommand::Check { scenario, set } => commands::check::check(&scenario, &set),
        cli::CliCommand::CrossCheck(args) => commands::cross_check::cross_check(&args),
        cli::CliCommand::Calibrate(args) => commands::calibrate::calibrate(&args),
        cli::CliCommand::Scenarios { name } => commands::scenarios::scenarios(name.as_deref()),
        cli::CliCommand::Schema { messages } => {
            print(&messages.map_or_else(hapfic_config::json_schema, commands::schema::messages));
            Ok(CommandOutcome::Done)
        }
        cli::CliCommand::Set { run, force, dry_run, changes } => {
            let kind = match (force, dry_run) {
                (_, true) => OperatorKind::SetDryRun,
                (true, false) => OperatorKind::SetForced,
                (false, false) => OperatorKind::Set,
            };
            commands::control::request(run.as_deref(), kind, &changes)
        }
        cli::CliCommand::Get { run, json, keys } => commands::control::get(run.as_deref(), json, &keys),
        cli::CliCommand::Status { run, json, once } => commands::status::status(run.as_deref(), json, once),
        cli::CliCommand::Stop { run } => commands::stop::stop(run.as_deref()),
        cli::CliCommand::Estop { run } => commands::control::request(run.as_deref(), OperatorKind::EmergencyStop, &[]),
        cli::CliCommand::Rearm { run } => commands::control::request(run.as_deref(), OperatorKind::Rearm, &[]),
        cli::CliCommand::Inject { run, fault } => commands::control::request(run.as_deref(), OperatorKind::Inject, &fault),
        cli::CliCommand::Stressor { supervisor, what } => commands::stressor::stressor(supervisor, &what),
        cli::CliCommand::Doctor { seconds, json } => commands::doctor::doctor(seconds, json),
        cli::CliCommand::Bench { what } => commands::bench::bench(&what),
        cli::CliCommand::BenchChain { words } => commands::bench::chain(&words),
        cli::CliCommand::BenchRun { parent, run } => commands::bench::run(parent, &run, since),
        cli::CliCommand::Timeline { log } => commands::timeline::timeline(&log),
        cli::CliCommand::Report(args) => commands::report::report(&args),
        cli::CliCommand::Recover { log, output } => commands::recover::recover(&log, output.as_deref()),
        cli::CliCommand::Process { name, external } => commands::process::process(name, &external),
    };
    match outcome {
        Ok(CommandOutcome::Done) if OUTPUT_FAILED.load(Ordering::Relaxed) => ExitCode::from(FAILED),
        Ok(CommandOutcome::Done) => ExitCode::SUCCESS,
        Ok(CommandOutcome::NotGoodEnough) => ExitCode::from(NOT_GOOD_ENOUGH),
        Ok(CommandOutcome::Failed) => ExitCode::from(FAILED),
        Ok(CommandOutcome::Rejected(e)) => {
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
enum CommandOutcome {
    /// The command did as requested.
    Done,
    /// What was judged, a machine for 1 kHz or gains for a robot, is not good enough; the reasons are printed.
    NotGoodEnough,
    /// The run failed; the reasons are printed.
    Failed,
    /// The input is invalid.
    Rejected(anyhow::Error),
}

/// Whether a write to standard output has failed.
static OUTPUT_FAILED: AtomicBool = AtomicBool::new(false);

/// Writes a line to standard output. A closed standard output is no failure; any other error makes the command fail.
fn print(text: &str) {
    let mut output = std::io::stdout();
    let written = writeln!(output, "{text}").and_then(|()| output.flush());
    if let Err(e) = written
        && e.kind() != std::io::ErrorKind::BrokenPipe
        && !OUTPUT_FAILED.swap(true, Ordering::Relaxed)
    {
        log_line(&format!("hapfic: cannot write to standard output: {e}"));
    }
}
