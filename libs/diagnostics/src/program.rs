//! A program that measures chains, from its command line to what it prints.

use crate::arguments::{What, Words};
use crate::driver::driver;
use crate::error::LatencyError;
use crate::link::Kind;
use crate::measured::Measured;
use crate::{relay, timer};
use clap::Parser;
use hapfic_ipc::clock;
use std::io::Write;
use std::process::ExitCode;

/// How long a program stays after its last round, ns: it gives back its memory at its own priority, and whatever is measured at the same time
/// should be over by then.
const STAY_NS: u64 = 200_000_000;

/// The kind that every such program has: no chain, a timer alone.
pub const TIMER: &str = "timer";

/// Does what the words say. `lead` are those of this program's command line that come before them.
///
/// # Errors
/// [`LatencyError`] if they make no sense, or the chain fails.
pub fn program(lead: &[&str], words: &[String], kinds: &[&dyn Kind]) -> Result<(), LatencyError> {
    let find = |name: &str| {
        kinds.iter().find(|kind| kind.name() == name).copied().ok_or_else(|| LatencyError::Kind {
            found: name.to_owned(),
            expected: kinds.iter().map(|kind| kind.name()).chain([TIMER]).collect::<Vec<_>>().join(", "),
        })
    };
    match Words::try_parse_from(words).map_err(|e| LatencyError::Arguments(e.to_string().trim_end().to_owned()))?.what {
        What::Kinds => kinds.iter().try_for_each(|kind| print(kind.name())),
        What::Chain(plan) if plan.kind == TIMER => tell(&timer::timer(TIMER, &plan, say_ready)?),
        What::Chain(plan) => tell(&driver(find(&plan.kind)?, &plan, lead, say_ready)?),
        What::Relay(words) => relay::serve(find(&words.kind)?, &words, |granted| {
            // A driver that has gone away has taken this process with it.
            let _ = print(&format!("ready {}", granted.0));
        }),
    }
}

/// The whole of a program that measures chains of some kinds.
#[must_use]
pub fn main(kinds: &[&dyn Kind]) -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    match program(&[], &words, kinds) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            // Nobody to tell is no reason to fail differently.
            let _ = writeln!(std::io::stderr(), "{e}");
            ExitCode::from(2)
        }
    }
}

fn say_ready() {
    // Whoever waits for it sees that it does not come.
    let _ = print("ready");
}

fn tell(measured: &Measured) -> Result<(), LatencyError> {
    clock::sleep_until(clock::now_ns() + STAY_NS);
    let line = serde_json::to_string(measured).map_err(|e| LatencyError::Said(e.to_string()))?;
    print(&line)
}

fn print(line: &str) -> Result<(), LatencyError> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush()).map_err(LatencyError::failed("standard output", "write"))
}
