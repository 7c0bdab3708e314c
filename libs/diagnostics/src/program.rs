//! Program that measures chains, from its command line to its output.

use crate::arguments::{ChainArguments, ChainCommand};
use crate::driver::driver;
use crate::error::LatencyError;
use crate::link::Kind;
use crate::measured::ChainMeasurement;
use crate::{relay, timer};
use clap::Parser;
use hapfic_ipc::clock;
use std::io::Write;
use std::process::ExitCode;

/// Delay of a program's end after its last round trip [ns].
///
/// The program frees its memory at its real-time priority; other measurements should have ended by then.
const END_DELAY_NS: u64 = 200_000_000;

/// Kind that every such program has: a timer without a chain.
pub const TIMER: &str = "timer";

/// Executes the command of the arguments; `prefix` are the arguments before them on this program's command line.
///
/// # Errors
/// [`LatencyError`] if the arguments are invalid, or the chain fails.
pub fn program(prefix: &[&str], arguments: &[String], kinds: &[&dyn Kind]) -> Result<(), LatencyError> {
    let find = |name: &str| {
        kinds.iter().find(|kind| kind.name() == name).copied().ok_or_else(|| LatencyError::Kind {
            found: name.to_owned(),
            expected: kinds.iter().map(|kind| kind.name()).chain([TIMER]).collect::<Vec<_>>().join(", "),
        })
    };
    let parsed = ChainArguments::try_parse_from(arguments);
    match parsed.map_err(|e| LatencyError::Arguments(e.to_string().trim_end().to_owned()))?.command {
        ChainCommand::Kinds => kinds.iter().try_for_each(|kind| print(kind.name())),
        ChainCommand::Chain(plan) if plan.kind == TIMER => print_measurement(&timer::timer(TIMER, &plan, print_ready)?),
        ChainCommand::Chain(plan) => print_measurement(&driver(find(&plan.kind)?, &plan, prefix, print_ready)?),
        ChainCommand::Relay(relay) => relay::serve(find(&relay.kind)?, &relay, |granted| {
            // Fails only if the driver has ended, and then this process ends, too.
            let _ = print(&format!("ready {}", granted.0));
        }),
    }
}

/// Main function of a program that measures chains of some kinds.
#[must_use]
pub fn main(kinds: &[&dyn Kind]) -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match program(&[], &arguments, kinds) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            // A closed standard error does not change the exit code.
            let _ = writeln!(std::io::stderr(), "{e}");
            ExitCode::from(2)
        }
    }
}

fn print_ready() {
    // The caller notices a missing line itself.
    let _ = print("ready");
}

fn print_measurement(measured: &ChainMeasurement) -> Result<(), LatencyError> {
    clock::sleep_until(clock::now_ns() + END_DELAY_NS);
    let line = serde_json::to_string(measured).map_err(|e| LatencyError::Output(e.to_string()))?;
    print(&line)
}

fn print(line: &str) -> Result<(), LatencyError> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush()).map_err(LatencyError::failed("standard output", "write"))
}
