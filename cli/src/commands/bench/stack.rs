//! The measured stack: a run of its own.

use super::arguments::LatencyArgs;
use super::output_paths::TemporaryFolder;
use anyhow::{Context, Result, bail, ensure};
use hapfic_ipc::{Bus, IpcError, RunFile, topic};
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

/// Time a run may take to its first tick, and to its end after the last.
const START_TIMEOUT: Duration = Duration::from_secs(20);
const END_TIMEOUT: Duration = Duration::from_secs(30);
/// Time a run may take to end after an interrupt.
const INTERRUPT_TIMEOUT: Duration = Duration::from_secs(5);
/// Interval at which the run is polled.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// States from which the phase is estimated.
const STATES: usize = 20;

/// A run; ended when dropped.
#[derive(Debug)]
pub(super) struct StackRun {
    child: Child,
    log: PathBuf,
    summary: PathBuf,
    stderr: PathBuf,
}

/// Phase and cores of a run.
#[derive(Clone, Copy, Debug)]
pub(super) struct RunTiming {
    /// A due time of the plant's timer, `CLOCK_MONOTONIC` [ns].
    pub(super) due_ns: u64,
    /// Core of the threads to which the settings assign none.
    pub(super) core: Option<u32>,
    /// Core of the gate.
    pub(super) gate_core: Option<u32>,
}

impl StackRun {
    /// Starts a run of `duration_s` [s].
    pub(super) fn start(args: &LatencyArgs, duration_s: u64, folder: &TemporaryFolder) -> Result<Self> {
        let (log, summary, stderr) = (folder.file("run.mcap"), folder.file("run.json"), folder.file("stderr.txt"));
        let output = std::fs::File::create(&stderr).with_context(|| format!("cannot write {}", stderr.display()))?;
        let mut command = this_program()?;
        command.args(["bench-run", &std::process::id().to_string(), &args.scenario]);
        command.args(["--duration", &duration_s.to_string()]);
        command.arg("--log").arg(&log).arg("--summary-json").arg(&summary);
        for set in &args.set {
            command.args(["--set", set]);
        }
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(output).spawn().context("cannot start the run")?;
        Ok(Self { child, log, summary, stderr })
    }

    /// Path of the log.
    pub(super) fn log(&self) -> &Path {
        &self.log
    }

    /// Waits until the run ticks, and reads its phase and cores; `None` if `stop` was set meanwhile.
    pub(super) fn find(&mut self, stop: &AtomicBool) -> Result<Option<RunTiming>> {
        let begun = Instant::now();
        let mut connection: Option<(Registration, Connection)> = None;
        loop {
            if stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            self.ensure_running()?;
            ensure!(
                begun.elapsed() < START_TIMEOUT,
                "the run has done no tick in {} s{}",
                START_TIMEOUT.as_secs(),
                self.output()
            );
            if connection.is_none() {
                let found = registry::running()?.into_iter().find(|run| run.pid == self.child.id());
                // The run accepts connections shortly after it has registered.
                connection = found.and_then(|run| Connection::open(&run).ok().map(|connection| (run, connection)));
            }
            if let Some((run, connection)) = &connection
                && tick(connection)?.is_some_and(|tick| tick > 0)
            {
                return read_timing(run).map(Some);
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }

    /// Fails if the run has ended.
    pub(super) fn ensure_running(&mut self) -> Result<()> {
        match self.child.try_wait().context("cannot wait for the run")? {
            Some(status) => {
                bail!(
                    "the run has ended before the measurement: {}{}",
                    hapfic_supervisor::children::describe(status),
                    self.output()
                )
            }
            None => Ok(()),
        }
    }

    /// Waits for the end of the run, and returns its summary; `None` if `stop` was set meanwhile.
    pub(super) fn finish(&mut self, stop: &AtomicBool) -> Result<Option<serde_json::Value>> {
        let begun = Instant::now();
        while self.ended()?.is_none() {
            if stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            ensure!(begun.elapsed() < END_TIMEOUT, "the run does not end{}", self.output());
            std::thread::sleep(POLL_INTERVAL);
        }
        let text =
            std::fs::read_to_string(&self.summary).with_context(|| format!("the run wrote no summary{}", self.output()))?;
        Ok(Some(serde_json::from_str(&text).context("the run's summary cannot be read")?))
    }

    fn ended(&mut self) -> Result<Option<ExitStatus>> {
        self.child.try_wait().context("cannot wait for the run")
    }

    /// Lists the privileges that the run lacks, from its own table.
    pub(super) fn missing_privileges(&self) -> Vec<String> {
        let text = std::fs::read_to_string(&self.stderr).unwrap_or_default();
        let missing = |line: &&str| ["not FIFO", "memory not locked", "NOT on core"].iter().any(|what| line.contains(what));
        text.lines().filter(missing).map(|line| format!("stack's {}", words(line))).collect()
    }

    fn output(&self) -> String {
        let text = std::fs::read_to_string(&self.stderr).unwrap_or_default();
        if text.trim().is_empty() { String::new() } else { format!("; its output:\n{}", text.trim_end()) }
    }
}

impl Drop for StackRun {
    fn drop(&mut self) {
        // Like Ctrl-C: the run ends its processes and removes its files.
        if matches!(self.ended(), Ok(None)) {
            let _ = kill_process(Pid::from_child(&self.child), Signal::INT);
        }
        let begun = Instant::now();
        while matches!(self.ended(), Ok(None)) {
            if begun.elapsed() > INTERRUPT_TIMEOUT {
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

/// Last tick of the run; `None` if it does not reply yet.
fn tick(connection: &Connection) -> Result<Option<i64>> {
    let Some(reply) = connection.ask(OperatorKind::Status, "")? else { return Ok(None) };
    match reply.parts()? {
        (ReplyCode::Done, text) => Ok(serde_json::from_str::<Status>(text).ok().map(|status| status.tick)),
        (ReplyCode::Rejected, text) => bail!("{text}"),
    }
}

/// Reads cores and phase of a run, the phase from some states; the run has already created its topics.
fn read_timing(run: &Registration) -> Result<RunTiming> {
    let domain = run.domain()?;
    let root = format!("/dev/shm/{}", run.run);
    let RunFile { core, gate_core, .. } = RunFile::read(&Path::new(&root).join("run.json"))?;
    let read_phase = || -> Result<Option<u64>, IpcError> {
        let bus = Bus::open(&domain, "bench")?;
        let mut input = bus.view_input(&topic::view::STATE)?;
        let (mut list, begun) = (Vec::new(), Instant::now());
        while list.len() < STATES && begun.elapsed() < Duration::from_secs(1) {
            while let Some(state) = input.next()? {
                list.push(state.stamp_ns - state.wake_lateness_ns);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(earliest(&list))
    };
    let due_ns = registry::while_alive(&run.run, read_phase)?.context("the run has ended before the measurement")??;
    Ok(RunTiming { due_ns: due_ns.context("the run publishes no states")?, core, gate_core })
}

/// Estimates a due time from the stamp with the earliest phase: stamps follow the timer, never precede it.
fn earliest(stamps: &[u64]) -> Option<u64> {
    let newest = *stamps.iter().max()?;
    // Phases relative to the newest stamp, across the end of the period.
    let after = stamps.iter().map(|stamp| (3 * PERIOD_NS / 2 + stamp % PERIOD_NS - newest % PERIOD_NS) % PERIOD_NS).min()?;
    Some((newest + after).saturating_sub(PERIOD_NS / 2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn earliest_takes_phase_of_soonest_stamp() {
        for base in [5_000_000, 5_400_000, 5_999_990, 5_000_010] {
            let stamps = [base + 30, base + 1_000_004, base + 2_000_120, base + 7_000_009];
            assert_eq!(earliest(&stamps), Some(base + 7_000_004), "{base}");
        }
        assert_eq!(earliest(&[]), None);
    }
}
