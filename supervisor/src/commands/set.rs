//! `hapfic set`: changes parameters of a running stack.

use crate::operator::client;
use crate::{Outcome, print};
use anyhow::Result;
use hapfic_ipc::service::OperatorKind;

/// All changes at one tick, or none. The stack itself checks them.
pub fn set(run: Option<&str>, changes: &[String]) -> Result<Outcome> {
    let done = client::find(run).and_then(|found| client::ask_once(&found, OperatorKind::Set, &changes.join("\0")));
    Ok(match done {
        Ok(text) => {
            print(&text);
            Outcome::Done
        }
        Err(e) => Outcome::Refused(e),
    })
}
