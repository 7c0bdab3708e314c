//! `hapfic stop`: ends a running stack like an interrupt from its terminal.

use crate::{CommandOutcome, log_line, print};
use anyhow::Result;
use hapfic_messages::OperatorKind;
use hapfic_supervisor::operator::client;
use hapfic_supervisor::registry::{self, Registration};
use std::time::{Duration, Instant};

/// Time a run may take to end.
const TIMEOUT: Duration = Duration::from_secs(10);
/// Interval at which the run is polled.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// Requests the end of a run, and waits for it.
pub fn stop(run: Option<&str>) -> Result<CommandOutcome> {
    let requested = client::find(run).and_then(|found| client::ask_once(&found, OperatorKind::Stop, "").map(|_| found));
    let found = match requested {
        Ok(found) => found,
        Err(e) => return Ok(CommandOutcome::Rejected(e)),
    };
    let begun = Instant::now();
    while is_running(&found)? {
        if begun.elapsed() > TIMEOUT {
            let seconds = TIMEOUT.as_secs();
            log_line(&format!("hapfic: run {}: still running {seconds} s after the request to end", found.run));
            return Ok(CommandOutcome::Failed);
        }
        std::thread::sleep(POLL_INTERVAL);
    }
    print(&format!("run {} has ended. Its log: {}", found.run, found.log.display()));
    Ok(CommandOutcome::Done)
}

fn is_running(found: &Registration) -> Result<bool> {
    Ok(registry::while_alive(&found.run, || ())?.is_some())
}
