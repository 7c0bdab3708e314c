//! `hapfic status`: how a running stack is.

use crate::{Outcome, print};
use anyhow::{Context, Result, bail};
use hapfic_messages::{OperatorKind, ReplyCode};
use hapfic_supervisor::operator::client::{self, Connection};
use hapfic_supervisor::operator::status::Status;
use hapfic_supervisor::registry::Registration;
use std::io::{IsTerminal, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How often the table is drawn.
const DRAW_EVERY: Duration = Duration::from_millis(250);

/// Prints the table once, or again and again in place if there is a terminal; or one JSON object.
pub fn status(run: Option<&str>, json: bool, once: bool) -> Result<Outcome> {
    let connected = client::find(run).and_then(|found| Connection::open(&found).map(|connection| (found, connection)));
    let (found, connection) = match connected {
        Ok(connected) => connected,
        Err(e) => return Ok(Outcome::Refused(e)),
    };
    let first = match ask(&connection, &found) {
        Ok(Some(status)) => status,
        Ok(None) => return Ok(Outcome::Refused(anyhow::anyhow!("run {} does not answer, expected its status", found.run))),
        Err(e) => return Ok(Outcome::Refused(e)),
    };
    if json {
        print(&serde_json::to_string_pretty(&first)?);
    } else if once || !std::io::stdout().is_terminal() {
        print(first.table().trim_end());
    } else {
        follow(&connection, &found, first)?;
    }
    Ok(Outcome::Done)
}

/// `None` if the run does not answer any more.
fn ask(connection: &Connection, found: &Registration) -> Result<Option<Status>> {
    let Some(reply) = connection.ask(OperatorKind::Status, "")? else { return Ok(None) };
    let text = match reply.parts()? {
        (ReplyCode::Done, text) => text,
        (ReplyCode::Refused, text) => bail!("{text}"),
    };
    let status: Status =
        serde_json::from_str(text).context("the run's status cannot be read; is it of another version of hapfic?")?;
    Ok(Some(Status { scenario: found.scenario.clone(), log: found.log.clone(), ..status }))
}

/// Draws until the run ends or somebody interrupts.
fn follow(connection: &Connection, found: &Registration, first: Status) -> Result<()> {
    let interrupted = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        // The connection is then closed in order.
        signal_hook::flag::register(signal, Arc::clone(&interrupted)).context("cannot handle signals")?;
    }
    let mut out = std::io::stdout();
    let mut drawn = 0;
    let mut next = Some(first);
    while let Some(status) = next {
        let table = status.table();
        // Back to the first line of the last table, and over it; a terminal that has gone away ends it.
        let up = if drawn > 0 { format!("\x1b[{drawn}A") } else { String::new() };
        // Long lines are cut, not wrapped: the way up counts lines.
        let lines: String = table.lines().map(|line| format!("\x1b[2K\x1b[?7l{line}\x1b[?7h\n")).collect();
        if write!(out, "{up}{lines}").and_then(|()| out.flush()).is_err() {
            return Ok(());
        }
        drawn = table.lines().count();
        std::thread::sleep(DRAW_EVERY);
        if interrupted.load(Ordering::Relaxed) || hapfic_supervisor::registry::while_alive(&found.run, || ())?.is_none() {
            break;
        }
        next = ask(connection, found)?;
    }
    Ok(())
}
