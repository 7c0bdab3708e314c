//! `hapfic set`, `estop`, `rearm` and `inject`: one request to a running stack.

use crate::{CommandOutcome, print};
use anyhow::Result;
use hapfic_messages::OperatorKind;
use hapfic_supervisor::operator::client;

/// Sends the request and prints the reply. The stack itself checks the words.
pub fn request(run: Option<&str>, kind: OperatorKind, words: &[String]) -> Result<CommandOutcome> {
    let text = words.join("\0");
    match client::find(run).and_then(|found| client::ask_once(&found, kind, &text)) {
        Ok(reply) => {
            print(&reply);
            Ok(CommandOutcome::Done)
        }
        Err(e) => Ok(CommandOutcome::Rejected(e)),
    }
}
