//! `hapfic timeline`: the parameter sets of a log as entries of a scenario.

use crate::{CommandOutcome, log_line, print};
use anyhow::Result;
use hapfic_log::{LogError, LogParts, timeline};
use std::path::Path;

/// Prints the entries. In place of the scenario's own, they reproduce the run in lockstep.
pub fn timeline(log: &Path) -> Result<CommandOutcome> {
    let reader = match LogParts::open(log) {
        Ok(reader) => reader,
        Err(e) => return Ok(CommandOutcome::Rejected(e.into())),
    };
    let scenario = reader.metadata().get("hapfic").and_then(|run| run.get("scenario")).cloned().unwrap_or_default();
    let (sets, ended) = timeline::sets(reader);
    match ended {
        None => {}
        // A killed run leaves a truncated log; its intact part still counts.
        Some(e @ LogError::Truncated { .. }) if !sets.is_empty() => log_line(&format!("hapfic: {e}")),
        Some(e) => return Ok(CommandOutcome::Rejected(e.into())),
    }
    if sets.is_empty() {
        return Ok(CommandOutcome::Rejected(anyhow::anyhow!(
            "{}: no parameter set on /operator, expected at least one",
            log.display()
        )));
    }
    // Names may contain line ends, which would end the comment.
    let plain = |text: &str| text.escape_debug().to_string();
    let header = format!(
        "# Parameters over time: scenario {}, log {}\n# Put them into the scenario in place of its own [[operator]] entries.",
        plain(&scenario),
        plain(&log.display().to_string())
    );
    print(&format!("{header}\n{}", timeline::entries(&sets).trim_end()));
    Ok(CommandOutcome::Done)
}
