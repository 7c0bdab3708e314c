//! Client of the operator service: finds a running stack and sends requests to it.

use crate::registry::{self, Registration};
use anyhow::{Context, Result, anyhow, bail};
use hapfic_ipc::service::RequestClient;
use hapfic_ipc::{Bus, IpcError};
use hapfic_messages::{OperatorKind, OperatorReply, OperatorRequest, ReplyCode};
use std::fmt::Write;
use std::time::{Duration, Instant};

/// Time a starting run may take until it accepts connections.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(3);
/// Time a reply may take: longer than the run waits for its own gate.
const REPLY_TIMEOUT: Duration = Duration::from_secs(3);
/// Interval between two attempts to connect.
const RETRY_INTERVAL: Duration = Duration::from_millis(20);

/// Finds the run with a name, or the only run.
///
/// # Errors
/// If there is none, or several and no name.
pub fn find(run: Option<&str>) -> Result<Registration> {
    let mut runs = registry::running()?;
    if runs.is_empty() {
        bail!("no stack is running, expected a stack of this user. Hint: start it with `hapfic run`");
    }
    let list = runs.iter().fold(String::new(), |mut list, r| {
        let _ = write!(list, "\n  {}  {}  {}", r.run, r.scenario, r.log.display());
        list
    });
    match run {
        Some(name) => {
            let index = runs.iter().position(|r| r.run == name);
            let index = index.with_context(|| format!("--run {name}: no such run, expected one of{list}"))?;
            Ok(runs.swap_remove(index))
        }
        None if runs.len() > 1 => {
            bail!("{} stacks are running, expected --run NAME with one of{list}", runs.len())
        }
        None => Ok(runs.swap_remove(0)),
    }
}

/// Connection to a run.
pub struct Connection {
    caller: RequestClient,
}

impl Connection {
    /// Connects to a run, which may still be starting.
    ///
    /// # Errors
    /// If the run has ended, or accepts no connection.
    pub fn open(registration: &Registration) -> Result<Self> {
        hapfic_ipc::service::silence_transport_log();
        let domain = registration.domain()?;
        let name = format!("client{}", std::process::id());
        let started = Instant::now();
        loop {
            let opened = registry::while_alive(&registration.run, || -> Result<RequestClient, IpcError> {
                RequestClient::open(&Bus::open(&domain, &name)?)
            })?;
            match opened {
                None => bail!("run {} has ended. Its log: {}", registration.run, registration.log.display()),
                Some(Ok(caller)) => return Ok(Self { caller }),
                Some(Err(e)) if started.elapsed() > CONNECT_TIMEOUT => {
                    return Err(e).with_context(|| format!("run {}: cannot connect", registration.run));
                }
                Some(Err(_)) => std::thread::sleep(RETRY_INTERVAL),
            }
        }
    }

    /// Sends a request and waits for the reply; `None` after the time-out.
    ///
    /// # Errors
    /// If the text is too long, or messaging fails.
    pub fn ask(&self, kind: OperatorKind, text: &str) -> Result<Option<OperatorReply>> {
        let request = OperatorRequest::new(kind, text).context("the request is too long")?;
        Ok(self.caller.ask(&request, REPLY_TIMEOUT)?)
    }
}

/// Connects to a run, sends one request, and disconnects. Returns the text of a positive reply.
///
/// # Errors
/// The reason if the run rejects the request or does not answer.
pub fn ask_once(registration: &Registration, kind: OperatorKind, text: &str) -> Result<String> {
    let reply = Connection::open(registration)?.ask(kind, text)?;
    let reply = reply.ok_or_else(|| {
        anyhow!("run {} does not answer: it has ended, or its supervisor hangs. Hint: see `hapfic status`", registration.run)
    })?;
    match reply.parts()? {
        (ReplyCode::Done, text) => Ok(text.to_owned()),
        (ReplyCode::Rejected, text) => Err(anyhow!("{text}")),
    }
}
