//! The real stack, as a run of its own.

use super::arguments::LatencyArgs;
use super::output_paths::Folder;
use anyhow::{Context, Result, bail, ensure};
use hapfic_ipc::{Bus, IpcError, RunFile, Wait, topic};
use hapfic_messages::{OperatorKind, PERIOD_NS, ReplyCode};
use hapfic_supervisor::children::this_program;
use hapfic_supervisor::operator::client::Connection;
use hapfic_supervisor::operator::status::Status;
use hapfic_supervisor::registry::{self, Registration};
use rustix::process::{Pid, Signal, kill_process};
use std::path::{Path, PathBuf};
use std::process::{Child, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How long a run may take to do its first tick, and to end after its last.
const START: Duration = Duration::from_secs(20);
const END: Duration = Duration::from_secs(30);
/// How often it is looked at.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// States from which the phase is taken.
const STATES: usize = 20;
/// A run; ended when dropped.
#[derive(Debug)]
pub(super) struct Stack {
    child: Child,
    log: PathBuf,
    summary: PathBuf,
    said: PathBuf,
}

/// Where and when a run works.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    /// Some time at which the plant's timer was due, ns of `CLOCK_MONOTONIC`.
    pub(super) due_ns: u64,
    /// Core of the threads that the settings give none.
    pub(super) core: Option<u32>,
    /// Core of the gate.
    pub(super) gate_core: Option<u32>,
}

impl Stack {
    /// Starts a run of so many seconds.
    pub(super) fn start(args: &LatencyArgs, duration_s: u64, folder: &Folder) -> Result<Self> {
        let (log, summary, said) = (folder.file("run.mcap"), folder.file("run.json"), folder.file("said.txt"));
        let output = std::fs::File::create(&said).with_context(|| format!("cannot write {}", said.display()))?;
        let mut command = this_program()?;
        command.args(["bench-run", &std::process::id().to_string(), &args.scenario]);
        command.args(["--duration", &duration_s.to_string()]);
        command.arg("--log").arg(&log).arg("--summary-json").arg(&summary);
        for set in &args.set {
            command.args(["--set", set]);
        }
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(output).spawn().context("cannot start the run")?;
        Ok(Self { child, log, summary, said })
    }

    /// Its log.
    pub(super) fn log(&self) -> &Path {
        &self.log
    }

    /// Waits until it ticks, and learns when. `None` if `stop` was set meanwhile.
    pub(super) fn find(&mut self, stop: &AtomicBool) -> Result<Option<Found>> {
        let begun = Instant::now();
        let mut connection: Option<(Registration, Connection)> = None;
        loop {
            if stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            self.ensure_running()?;
            ensure!(begun.elapsed() < START, "the run has done no tick in {} s{}", START.as_secs(), self.said());
            if connection.is_none() {
                let found = registry::running()?.into_iter().find(|run| run.pid == self.child.id());
                // It can be asked a little after it has registered.
                connection = found.and_then(|run| Connection::open(&run).ok().map(|connection| (run, connection)));
            }
            if let Some((run, connection)) = &connection
                && tick(connection)?.is_some_and(|tick| tick > 0)
            {
                return look(run).map(Some);
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }

    /// That it has not ended.
    pub(super) fn ensure_running(&mut self) -> Result<()> {
        match self.child.try_wait().context("cannot wait for the run")? {
            Some(status) => {
                bail!(
                    "the run has ended before the measurement: {}{}",
                    hapfic_supervisor::children::describe(status),
                    self.said()
                )
            }
            None => Ok(()),
        }
    }

    /// Waits for its end; what it sums up.
    pub(super) fn finish(&mut self, stop: &AtomicBool) -> Result<Option<serde_json::Value>> {
        let begun = Instant::now();
        while self.ended()?.is_none() {
            if stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            ensure!(begun.elapsed() < END, "the run does not end{}", self.said());
            std::thread::sleep(POLL_INTERVAL);
        }
        let text = std::fs::read_to_string(&self.summary).with_context(|| format!("the run wrote no summary{}", self.said()))?;
        Ok(Some(serde_json::from_str(&text).context("the run's summary cannot be read")?))
    }

    fn ended(&mut self) -> Result<Option<ExitStatus>> {
        self.child.try_wait().context("cannot wait for the run")
    }

    /// Privileges that it lacks, as its own table says.
    pub(super) fn lacks(&self) -> Vec<String> {
        let text = std::fs::read_to_string(&self.said).unwrap_or_default();
        let lacking = |line: &&str| ["not FIFO", "memory not locked", "NOT on core"].iter().any(|what| line.contains(what));
        text.lines().filter(lacking).map(|line| format!("stack's {}", words(line))).collect()
    }

    fn said(&self) -> String {
        let text = std::fs::read_to_string(&self.said).unwrap_or_default();
        if text.trim().is_empty() { String::new() } else { format!("; it said:\n{}", text.trim_end()) }
    }
}

impl Drop for Stack {
    fn drop(&mut self) {
        // As Ctrl-C would: it ends its processes and removes what is its own.
        if matches!(self.ended(), Ok(None)) {
            let _ = kill_process(Pid::from_child(&self.child), Signal::INT);
        }
        let begun = Instant::now();
        while matches!(self.ended(), Ok(None)) {
            if begun.elapsed() > Duration::from_secs(5) {
                let _ = self.child.kill();
                let _ = self.child.wait();
                return;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }
}

fn words(line: &str) -> String {
    line.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The run's last tick; none if it does not answer yet.
fn tick(connection: &Connection) -> Result<Option<i64>> {
    let Some(reply) = connection.ask(OperatorKind::Status, "")? else { return Ok(None) };
    match reply.parts()? {
        (ReplyCode::Done, text) => Ok(serde_json::from_str::<Status>(text).ok().map(|status| status.tick)),
        (ReplyCode::Refused, text) => bail!("{text}"),
    }
}

/// Listens to some states of a run that has made its topics, and to no more.
fn look(run: &Registration) -> Result<Found> {
    let domain = run.domain()?;
    let root = format!("/dev/shm/{}", run.run);
    let RunFile { core, gate_core, .. } = RunFile::read(&Path::new(&root).join("run.json"))?;
    let listen = || -> Result<Option<u64>, IpcError> {
        let bus = Bus::open(&domain, "bench")?;
        let mut input = bus.input(&topic::STATE, Wait::No)?;
        let (mut list, begun) = (Vec::new(), Instant::now());
        while list.len() < STATES && begun.elapsed() < Duration::from_secs(1) {
            while let Some(state) = input.next()? {
                list.push(state.stamp_ns - state.wake_lateness_ns);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(earliest(&list))
    };
    let due_ns = registry::while_alive(&run.run, listen)?.context("the run has ended before the measurement")??;
    Ok(Found { due_ns: due_ns.context("the run publishes no states")?, core, gate_core })
}

/// The due time that was stamped soonest: stamps come a little after the timer, never before it.
fn earliest(stamps: &[u64]) -> Option<u64> {
    let newest = *stamps.iter().max()?;
    // From the newest one down, over the period's end.
    let after = stamps.iter().map(|stamp| (3 * PERIOD_NS / 2 + stamp % PERIOD_NS - newest % PERIOD_NS) % PERIOD_NS).min()?;
    Some((newest + after).saturating_sub(PERIOD_NS / 2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_phase_is_that_of_the_soonest_stamp() {
        for base in [5_000_000, 5_400_000, 5_999_990, 5_000_010] {
            let stamps = [base + 30, base + 1_000_004, base + 2_000_120, base + 7_000_009];
            assert_eq!(earliest(&stamps), Some(base + 7_000_004), "{base}");
        }
        assert_eq!(earliest(&[]), None);
    }
}
