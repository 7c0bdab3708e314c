//! `hapfic set`, `estop`, `rearm` and `inject`: one thing asked of a running stack, and its answer printed.

use crate::{Outcome, print};
use anyhow::Result;
use hapfic_messages::OperatorKind;
use hapfic_supervisor::operator::client;

/// Asks, and prints the answer. The stack itself checks the words.
pub fn order(run: Option<&str>, kind: OperatorKind, words: &[String]) -> Result<Outcome> {
    let text = words.join("\0");
    match client::find(run).and_then(|found| client::ask_once(&found, kind, &text)) {
        Ok(answer) => {
            print(&answer);
            Ok(Outcome::Done)
        }
        Err(e) => Ok(Outcome::Refused(e)),
    }
}
