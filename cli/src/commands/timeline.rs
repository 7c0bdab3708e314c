//! `hapfic timeline`: the parameter sets of a log as entries of a scenario.

use crate::{Outcome, print, say};
use anyhow::Result;
use hapfic_log::{LogError, Reader, timeline};
use std::path::Path;

/// Prints the entries. In place of the scenario's own, they make the same run again in lockstep.
pub fn timeline(log: &Path) -> Result<Outcome> {
    let reader = match Reader::open(log) {
        Ok(reader) => reader,
        Err(e) => return Ok(Outcome::Refused(e.into())),
    };
    let scenario = reader.metadata().get("hapfic").and_then(|run| run.get("scenario")).cloned().unwrap_or_default();
    let (sets, ended) = timeline::sets(reader);
    match ended {
        None => {}
        // What a run has written until it was killed is worth having.
        Some(e @ LogError::Truncated { .. }) if !sets.is_empty() => say(&format!("hapfic: {e}")),
        Some(e) => return Ok(Outcome::Refused(e.into())),
    }
    if sets.is_empty() {
        return Ok(Outcome::Refused(anyhow::anyhow!("{}: no parameter set on /operator, expected at least one", log.display())));
    }
    // Names may hold anything; a comment ends with its line.
    let plain = |text: &str| text.escape_debug().to_string();
    let header = format!(
        "# What was in force when: scenario {}, log {}\n# Put it into the scenario in place of its own [[operator]] entries.",
        plain(&scenario),
        plain(&log.display().to_string())
    );
    print(&format!("{header}\n{}", timeline::entries(&sets).trim_end()));
    Ok(Outcome::Done)
}
