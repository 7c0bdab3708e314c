//! `hapfic set`, `get`, `estop`, `rearm` and `inject`: one request to a running stack.

use crate::{CommandOutcome, print};
use anyhow::Result;
use hapfic_messages::OperatorKind;
use hapfic_supervisor::operator::client;
use serde_json::{Map, Value};

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

/// Prints the parameters in force: all, or those of `keys`.
pub fn get(run: Option<&str>, json: bool, keys: &[String]) -> Result<CommandOutcome> {
    let text = keys.join("\0");
    match client::find(run).and_then(|found| client::ask_once(&found, OperatorKind::Get, &text)) {
        Ok(reply) if json => {
            // A value reads the same in TOML and in JSON.
            let pairs = reply.lines().filter_map(|line| line.split_once(" = "));
            let values: Map<String, Value> =
                pairs.map(|(key, value)| Ok((key.to_owned(), serde_json::from_str(value)?))).collect::<Result<_>>()?;
            print(&serde_json::to_string_pretty(&Value::Object(values))?);
            Ok(CommandOutcome::Done)
        }
        Ok(reply) => {
            print(&reply);
            Ok(CommandOutcome::Done)
        }
        Err(e) => Ok(CommandOutcome::Rejected(e)),
    }
}
