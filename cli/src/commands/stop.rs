//! `hapfic stop`: ends a running stack, as an interrupt from its terminal would.

use crate::{Outcome, print, say};
use anyhow::Result;
use hapfic_messages::OperatorKind;
use hapfic_supervisor::operator::client;
use hapfic_supervisor::registry::{self, Registration};
use std::time::{Duration, Instant};

/// How long a run may take to end.
const TIMEOUT: Duration = Duration::from_secs(10);
/// How often it is looked for.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// Asks a run to end, and waits until it has.
pub fn stop(run: Option<&str>) -> Result<Outcome> {
    let asked = client::find(run).and_then(|found| client::ask_once(&found, OperatorKind::Stop, "").map(|_| found));
    let found = match asked {
        Ok(found) => found,
        Err(e) => return Ok(Outcome::Refused(e)),
    };
    let begun = Instant::now();
    while is_running(&found)? {
        if begun.elapsed() > TIMEOUT {
            let seconds = TIMEOUT.as_secs();
            say(&format!("hapfic: run {} has been asked to end and still runs after {seconds} s", found.run));
            return Ok(Outcome::Failed);
        }
        std::thread::sleep(POLL_INTERVAL);
    }
    print(&format!("run {} has ended. Its log: {}", found.run, found.log.display()));
    Ok(Outcome::Done)
}

fn is_running(found: &Registration) -> Result<bool> {
    Ok(registry::while_alive(&found.run, || ())?.is_some())
}
