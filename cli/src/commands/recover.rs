//! `hapfic recover`: makes a readable copy of a truncated or damaged log.

use crate::{CommandOutcome, print};
use anyhow::Result;
use hapfic_log::{Recovery, TickGaps};
use std::fmt::Write;
use std::path::Path;

/// Recovers a log, part by part, and prints what the copies keep and what is lost.
pub fn recover(log: &Path, output: Option<&Path>) -> Result<CommandOutcome> {
    let parts = hapfic_log::parts(log);
    if let (Some(output), true) = (output, parts.len() > 1) {
        return Ok(CommandOutcome::Rejected(anyhow::anyhow!(
            "{}: found {} parts for the one output {}, expected one. Hint: without --output each is recovered beside itself; or give the path of one part",
            log.display(),
            parts.len(),
            output.display()
        )));
    }
    let mut outcome = CommandOutcome::Done;
    for part in &parts {
        // The others are recovered all the same; the first failure decides the exit code.
        match (recover_part(part, output)?, &outcome) {
            (CommandOutcome::Rejected(error), CommandOutcome::Done) => outcome = CommandOutcome::Rejected(error),
            (CommandOutcome::Rejected(error), _) => crate::log_line(&format!("hapfic: {error}")),
            _ => {}
        }
    }
    Ok(outcome)
}

fn recover_part(log: &Path, output: Option<&Path>) -> Result<CommandOutcome> {
    match hapfic_log::recover(log, output) {
        Ok(found) => {
            print(text(log, &found).trim_end());
            Ok(CommandOutcome::Done)
        }
        Err(e) if e.is_invalid_request() => Ok(CommandOutcome::Rejected(e.into())),
        Err(e) => Err(e.into()),
    }
}

/// Formats the result of the recovery.
fn text(log: &Path, found: &Recovery) -> String {
    let mut lines = vec![match &found.output {
        None => format!("{}: whole, no copy was made", log.display()),
        Some(output) => format!("{}: recovered to {}", log.display(), output.display()),
    }];
    let topics: Vec<_> = found.messages.iter().map(|(topic, count)| format!("{topic} {count}")).collect();
    lines.push(format!("messages     {} kept: {}", found.message_count(), topics.join(", ")));
    if found.unchecked > 0 {
        lines.push(format!("             {} of them from damaged chunks, without a checksum", found.unchecked));
    }
    lines.push(match found.ticks() {
        Some((first, last)) => format!("ticks        {first} to {last}"),
        None => "ticks        none".to_owned(),
    });
    lines.extend(gaps("/state", &found.states));
    lines.extend(gaps("/command", &found.commands));
    lines.push(format!("attachments  {}", listed(&found.attachments)));
    lines.push(format!("metadata     {}", listed(&found.metadata)));
    if found.output.is_some() {
        lines.push(format!("damage       {} of {} bytes, in {} places", found.lost_bytes, found.file_bytes, found.loss_count));
        lines.extend(found.losses.iter().map(|loss| format!("             {}", loss.text())));
        let more = found.loss_count.saturating_sub(found.losses.len() as u64);
        if more > 0 {
            lines.push(format!("             and {more} more"));
        }
    }
    if !found.rebuilt.is_empty() {
        let topics: Vec<_> = found.rebuilt.iter().map(String::as_str).collect();
        lines.push(format!("schemas      those of this program for {}: the log's own are damaged", topics.join(", ")));
    }
    let mut text = String::new();
    for line in lines {
        let _ = writeln!(text, "{line}");
    }
    text
}

fn gaps(topic: &str, ticks: &TickGaps) -> Option<String> {
    (ticks.count > 0).then(|| format!("missing      {} ticks of {topic}: {}", ticks.missing, ticks.text()))
}

fn listed(names: &[String]) -> String {
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}
