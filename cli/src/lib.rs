//! `hapfic`: launches the stack, gates torque, watches the processes and records everything.
//!
//! Exit codes: 0 the run completed, or the question was answered; 1 the machine is not good enough (`doctor`); 2 what was asked for is no good, nothing was started; 3 the
//! run failed.

mod cli;
mod commands;

use clap::Parser;
use hapfic_messages::OperatorKind;
use hapfic_supervisor::say;
use std::io::Write;
use std::process::ExitCode;
use std::time::Instant;

/// The machine is not good enough.
const NOT_GOOD_ENOUGH: u8 = 1;
/// What was asked for is no good.
const BAD_INPUT: u8 = 2;
/// The run failed.
const FAILED: u8 = 3;

/// The program: reads the command line and does what it says.
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
        cli::Command::Set { run, changes } => commands::control::order(run.as_deref(), OperatorKind::Set, &changes),
        cli::Command::Status { run, json, once } => commands::status::status(run.as_deref(), json, once),
        cli::Command::Stop { run } => commands::stop::stop(run.as_deref()),
        cli::Command::Estop { run } => commands::control::order(run.as_deref(), OperatorKind::EmergencyStop, &[]),
        cli::Command::Rearm { run } => commands::control::order(run.as_deref(), OperatorKind::Rearm, &[]),
        cli::Command::Inject { run, fault } => commands::control::order(run.as_deref(), OperatorKind::Inject, &fault),
        cli::Command::Nuisance { supervisor, what } => commands::stressor::nuisance(supervisor, &what),
        cli::Command::Doctor { seconds, json } => commands::doctor::doctor(seconds, json),
        cli::Command::Bench { what } => commands::bench::bench(&what),
        cli::Command::BenchChain { words } => commands::bench::chain(&words),
        cli::Command::BenchRun { parent, run } => commands::bench::run(parent, &run, since),
        cli::Command::Timeline { log } => commands::timeline::timeline(&log),
        cli::Command::Report(args) => commands::report::report(&args),
        cli::Command::Recover { log, output } => commands::recover::recover(&log, output.as_deref()),
        cli::Command::Process { name, foreign } => commands::process::process(name, &foreign),
    };
    match outcome {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::NotGoodEnough) => ExitCode::from(NOT_GOOD_ENOUGH),
        Ok(Outcome::Failed) => ExitCode::from(FAILED),
        Ok(Outcome::Refused(e)) => {
            say(&format!("hapfic: {e:#}"));
            ExitCode::from(BAD_INPUT)
        }
        Err(e) => {
            say(&format!("hapfic: {e:#}"));
            ExitCode::from(FAILED)
        }
    }
}

/// How a command ended.
enum Outcome {
    /// As asked.
    Done,
    /// The machine is not good enough for 1 kHz; why has been said.
    NotGoodEnough,
    /// The run failed; what there is to say has been said.
    Failed,
    /// It cannot be done as asked.
    Refused(anyhow::Error),
}

/// To standard output. A reader that has gone away is no reason to fail.
fn print(text: &str) {
    let _ = writeln!(std::io::stdout(), "{text}");
}
