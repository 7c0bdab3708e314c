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
    let several = reader.part_count() > 1;
    let (sets, errors) = timeline::sets(reader);
    for error in errors {
        // A killed run leaves a truncated log; what is intact still counts, and so do the other parts of a log.
        if !sets.is_empty() && (several || matches!(error, LogError::Truncated { .. })) {
            log_line(&format!("hapfic: {error}"));
        } else {
            return Ok(CommandOutcome::Rejected(error.into()));
        }
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
