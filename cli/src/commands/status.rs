//! `hapfic status`: shows the status of a running stack.

use crate::{CommandOutcome, print};
use anyhow::{Context, Result, bail};
use hapfic_messages::{OperatorKind, ReplyCode};
use hapfic_supervisor::operator::client::{self, Connection};
use hapfic_supervisor::operator::status::Status;
use hapfic_supervisor::registry::Registration;
use std::io::{IsTerminal, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Interval between two drawings of the table.
const DRAW_INTERVAL: Duration = Duration::from_millis(250);

/// Prints the table once, or repeatedly in place on a terminal; or one JSON object.
pub fn status(run: Option<&str>, json: bool, once: bool) -> Result<CommandOutcome> {
    let connected = client::find(run).and_then(|found| Connection::open(&found).map(|connection| (found, connection)));
    let (found, connection) = match connected {
        Ok(connected) => connected,
        Err(e) => return Ok(CommandOutcome::Rejected(e)),
    };
    let first = match ask(&connection, &found) {
        Ok(Some(status)) => status,
        Ok(None) => {
            return Ok(CommandOutcome::Rejected(anyhow::anyhow!("run {} does not answer, expected its status", found.run)));
        }
        Err(e) => return Ok(CommandOutcome::Rejected(e)),
    };
    if json {
        print(&serde_json::to_string_pretty(&first)?);
    } else if once || !std::io::stdout().is_terminal() {
        print(first.table().trim_end());
    } else {
        follow(&connection, &found, first)?;
    }
    Ok(CommandOutcome::Done)
}

/// Asks the run for its status; `None` if it does not reply.
fn ask(connection: &Connection, found: &Registration) -> Result<Option<Status>> {
    let Some(reply) = connection.ask(OperatorKind::Status, "")? else { return Ok(None) };
    let text = match reply.parts()? {
        (ReplyCode::Done, text) => text,
        (ReplyCode::Rejected, text) => bail!("{text}"),
    };
    let status: Status =
        serde_json::from_str(text).context("the run's status cannot be read. Hint: it may run another version of hapfic")?;
    Ok(Some(Status { scenario: found.scenario.clone(), log: found.log.clone(), ..status }))
}

/// Draws the table until the run ends or a signal comes.
fn follow(connection: &Connection, found: &Registration, first: Status) -> Result<()> {
    let interrupted = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        // A handled signal lets the connection close in order.
        signal_hook::flag::register(signal, Arc::clone(&interrupted)).context("cannot handle signals")?;
    }
    let mut out = std::io::stdout();
    let mut drawn = 0;
    let mut next = Some(first);
    while let Some(status) = next {
        let table = status.table();
        // Back to the first line of the last table, to overwrite it; a closed terminal ends the command.
        let up = if drawn > 0 { format!("\x1b[{drawn}A") } else { String::new() };
        // Long lines are cut, not wrapped: the cursor moves up by lines.
        let lines: String = table.lines().map(|line| format!("\x1b[2K\x1b[?7l{line}\x1b[?7h\n")).collect();
        if write!(out, "{up}{lines}").and_then(|()| out.flush()).is_err() {
            return Ok(());
        }
        drawn = table.lines().count();
        std::thread::sleep(DRAW_INTERVAL);
        if interrupted.load(Ordering::Relaxed) || hapfic_supervisor::registry::while_alive(&found.run, || ())?.is_none() {
            break;
        }
        next = ask(connection, found)?;
    }
    Ok(())
}
