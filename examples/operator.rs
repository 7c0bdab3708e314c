//! Finds a running stack, asks for its status, and changes the desired force.
//!
//! Start a stack in another terminal first. `set` changes all its values at one tick in all processes, or none.
//!
//! ```sh
//! cargo run --release -- run floor --duration 60
//! cargo run --release -p hapfic-examples --bin operator -- desired_force.z=60 taper=0.1
//! ```
#![allow(clippy::print_stdout)]

use anyhow::{Context, Result};
use hapfic_messages::OperatorKind;
use hapfic_supervisor::operator::client;
use hapfic_supervisor::operator::status::Status;

/// Separator of the values of a change.
const SEPARATOR: &str = "\0";

fn main() -> Result<()> {
    // Finds the only run of this user; with several runs the error lists them.
    let run = client::find(None)?;
    println!("run {} of scenario {}, log {}", run.run, run.scenario, run.log.display());

    // The status travels as JSON.
    let text = client::ask_once(&run, OperatorKind::Status, "")?;
    let status: Status = serde_json::from_str(&text).context("the status is of another version of hapfic")?;
    println!("tick {} of {}, {}", status.tick, status.end_tick, status.mode);
    println!("force {:.1?} N, desired {:.1?} N", status.force_n, status.desired_force_n);

    // The supervisor checks the change like a scenario. Its reply names the version and the tick, or the error.
    let changes: Vec<String> = std::env::args().skip(1).collect();
    let changes = if changes.is_empty() { vec!["desired_force.z=60".to_owned()] } else { changes };
    let reply = client::ask_once(&run, OperatorKind::Set, &changes.join(SEPARATOR))?;
    println!("{reply}");
    Ok(())
}
