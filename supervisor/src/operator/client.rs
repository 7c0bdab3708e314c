//! The side that asks: finds a running stack and talks to it.

use crate::registry::{self, Registration};
use anyhow::{Context, Result, anyhow, bail};
use hapfic_ipc::service::Caller;
use hapfic_ipc::{Bus, IpcError};
use hapfic_messages::{OperatorKind, OperatorReply, OperatorRequest, ReplyCode};
use std::fmt::Write;
use std::time::{Duration, Instant};

/// How long a run that has just begun may take until it can be asked.
const CONNECT_PATIENCE: Duration = Duration::from_secs(3);
/// How long a reply may take: longer than the run waits for its own gate.
const REPLY_PATIENCE: Duration = Duration::from_secs(3);
/// How often it is tried again.
const AGAIN: Duration = Duration::from_millis(20);

/// The run that is meant: the one with this name, or the only one.
///
/// # Errors
/// If there is none, or more than one and no name.
pub fn find(run: Option<&str>) -> Result<Registration> {
    let mut runs = registry::running()?;
    if runs.is_empty() {
        bail!("no stack is running, expected one of this user. Hint: start one with `hapfic run`");
    }
    let list = runs.iter().fold(String::new(), |mut list, r| {
        let _ = write!(list, "\n  {}  {}  {}", r.run, r.scenario, r.log.display());
        list
    });
    match run {
        Some(name) => {
            let at = runs.iter().position(|r| r.run == name);
            let at = at.with_context(|| format!("--run {name}: no such run, expected one of{list}"))?;
            Ok(runs.swap_remove(at))
        }
        None if runs.len() > 1 => {
            bail!("{} stacks are running, expected --run NAME with one of{list}", runs.len())
        }
        None => Ok(runs.swap_remove(0)),
    }
}

/// A connection to a run.
pub struct Connection {
    caller: Caller,
}

impl Connection {
    /// Connects to a run, which may still be starting.
    ///
    /// # Errors
    /// If it has ended, or cannot be asked.
    pub fn open(registration: &Registration) -> Result<Self> {
        hapfic_ipc::service::quiet();
        let domain = registration.domain()?;
        let name = format!("client{}", std::process::id());
        let begun = Instant::now();
        loop {
            let opened = registry::while_alive(&registration.run, || -> Result<Caller, IpcError> {
                Caller::open(&Bus::open(&domain, &name)?)
            })?;
            match opened {
                None => bail!("run {} has ended. Its log: {}", registration.run, registration.log.display()),
                Some(Ok(caller)) => return Ok(Self { caller }),
                Some(Err(e)) if begun.elapsed() > CONNECT_PATIENCE => {
                    return Err(e).with_context(|| format!("run {} cannot be asked", registration.run));
                }
                Some(Err(_)) => std::thread::sleep(AGAIN),
            }
        }
    }

    /// Asks; `None` if there is no answer.
    ///
    /// # Errors
    /// If the text is too long, or messaging fails.
    pub fn ask(&self, kind: OperatorKind, text: &str) -> Result<Option<OperatorReply>> {
        let request = OperatorRequest::new(kind, text).context("the request is too long")?;
        Ok(self.caller.ask(&request, REPLY_PATIENCE)?)
    }
}

/// Finds a run, asks it one thing, and disconnects. The reply's text, if it was done.
///
/// # Errors
/// Why it was not.
pub fn ask_once(registration: &Registration, kind: OperatorKind, text: &str) -> Result<String> {
    let reply = Connection::open(registration)?.ask(kind, text)?;
    let reply = reply.ok_or_else(|| {
        anyhow!("run {} does not answer: it has ended, or its supervisor hangs. Hint: see `hapfic status`", registration.run)
    })?;
    match reply.parts()? {
        (ReplyCode::Done, text) => Ok(text.to_owned()),
        (ReplyCode::Refused, text) => Err(anyhow!("{text}")),
    }
}
