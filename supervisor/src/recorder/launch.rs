//! The supervisor's side of the recorder: its start, its end, and what outlives it.

use super::{RecordingOutcome, tasks};
use crate::children::{self, Child};
use crate::watch::RecorderEnd;
use anyhow::{Context, Result};
use hapfic_config::Settings;
use hapfic_ipc::{ProcessStart, RecorderPage};
use hapfic_log::{LogFigures, LogFile, Remainder};
use hapfic_messages::{Clock, Phase, Process};
use rustix::process::Signal;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

/// Time without a message written after which the end no longer waits for the recorder: a disk that hangs.
const GIVE_UP: Duration = Duration::from_secs(30);
/// Interval at which the end looks whether the recorder is done.
const FINISH_POLL: Duration = Duration::from_millis(2);
/// Recorders that may be lost while they write the end of the log.
const LOST_AT_END: u32 = 5;

/// Arguments of [`Recorder::new`].
pub struct RecorderStart<'a> {
    /// The run's folder.
    pub root: PathBuf,
    /// Clock of the run.
    pub clock: Clock,
    /// The checked scenario.
    pub settings: &'a Settings,
    /// Path of the run file.
    pub run_file: &'a Path,
    /// Path of the log.
    pub log: &'a Path,
    /// The created log.
    pub file: LogFile,
}

/// The recorder of a run, as the supervisor sees it. It holds the lock of the log as long as the run lasts.
pub struct Recorder<'a> {
    page: RecorderPage,
    root: PathBuf,
    clock: Clock,
    settings: &'a Settings,
    run_file: &'a Path,
    log: &'a Path,
    file: LogFile,
}

impl<'a> Recorder<'a> {
    /// Opens the page that outlives a recorder.
    ///
    /// # Errors
    /// If the page cannot be shared.
    pub fn new(start: RecorderStart<'a>) -> Result<Self> {
        let RecorderStart { root, clock, settings, run_file, log, file } = start;
        let page = RecorderPage::open(&root.to_string_lossy())?;
        Ok(Self { page, root, clock, settings, run_file, log, file })
    }

    /// Starts a recorder, with the first part of the log as its standard input.
    ///
    /// # Errors
    /// If the process cannot be started.
    pub fn start(&self, start: ProcessStart) -> Result<Child> {
        let log = Stdio::from(self.file.handle()?);
        Child::start(Process::Recorder, self.settings, self.run_file, start, log)
    }

    /// Page of the recorder.
    #[must_use]
    pub fn page(&self) -> &RecorderPage {
        &self.page
    }

    /// Whether a successor can continue the log: a pipe has no parts.
    #[must_use]
    pub fn can_resume(&self) -> bool {
        self.file.is_regular()
    }

    /// Waits until the recorder has received and written everything; no longer than 30 s in which no message is written.
    /// The log then ends where the disk hung; `hapfic recover` reads it. In lockstep a successor takes the place of a
    /// recorder that is lost meanwhile.
    ///
    /// `generation` is that of the last recorder.
    #[must_use]
    pub fn finish(&self, (end, generation): (RecorderEnd, u32)) -> RecordingOutcome {
        self.page.order_drain();
        let (mut generation, mut lost) = (generation, generation > 0);
        let mut ended = match end {
            RecorderEnd::Running(child) => Some(self.wait(child, generation)),
            // A supervisor that is lost now has waited for it.
            RecorderEnd::Lost if RecordingOutcome::read(&self.root, generation).is_some() => Some(End::Done),
            RecorderEnd::Lost => Some(End::Lost("was lost at the end".to_owned())),
            RecorderEnd::GivenUp => None,
        };
        for _ in 0..LOST_AT_END {
            if self.clock == Clock::Realtime || !self.can_resume() || !matches!(ended, Some(End::Lost(_))) {
                break;
            }
            generation += 1;
            let start = ProcessStart { generation };
            ended = self.start(start).ok().map(|child| self.wait(child, generation));
            lost = true;
        }
        let left = RecordingOutcome::read(&self.root, generation);
        let has_left = left.is_some();
        let mut outcome = left.unwrap_or_default();
        let done = matches!(ended, Some(End::Done));
        match ended {
            Some(End::Done) if has_left => {}
            Some(End::Done) => {
                outcome.error = Some("the recorder left no result".to_owned());
            }
            Some(End::Lost(what)) => {
                lost = true;
                if self.clock == Clock::Lockstep || !self.can_resume() {
                    outcome.error.get_or_insert(format!("the recorder {what}"));
                } else {
                    // As a loss before: what is missing is counted.
                    crate::log_line(&format!("hapfic: the recorder {what} while it wrote the end of the log"));
                }
            }
            Some(End::Hangs) => {
                let what = format!("the log could not be finished: no message was written for {} s", GIVE_UP.as_secs());
                outcome.error.get_or_insert(what);
            }
            None => {
                lost = true;
                outcome.error.get_or_insert("the recorder was lost too often".to_owned());
            }
        }
        if outcome.tasks.is_empty() {
            outcome.tasks = tasks(&self.root);
        }
        if lost && self.can_resume() {
            if !done {
                let flushed = self.page.flushed();
                // A failure leaves a cut-off part, which `hapfic recover` reads.
                let _ = hapfic_log::close_last_part(self.log, flushed.part, flushed.bytes, Remainder::Kept);
            }
            match LogFigures::of_log(self.log) {
                Ok(figures) => outcome.figures = Some(figures),
                Err(e) => {
                    outcome.error.get_or_insert(e.to_string());
                }
            }
        }
        outcome
    }

    /// Waits for the end of a recorder.
    fn wait(&self, mut child: Child, generation: u32) -> End {
        let (mut written, mut since) = (self.page.written(), Instant::now());
        loop {
            match child.ended() {
                Ok(Some(children::End::Status(status))) if status.success() => return End::Done,
                // A recorder that ends in order leaves its result first.
                Ok(Some(children::End::Unknown)) if RecordingOutcome::read(&self.root, generation).is_some() => return End::Done,
                Ok(Some(end)) => return End::Lost(end.to_string()),
                Ok(None) => {}
                Err(e) => return End::Lost(format!("{e:#}")),
            }
            if written != self.page.written() {
                (written, since) = (self.page.written(), Instant::now());
            } else if since.elapsed() >= GIVE_UP {
                child.signal(Signal::KILL);
                return End::Hangs;
            }
            std::thread::sleep(FINISH_POLL);
        }
    }
}

/// End of a recorder.
enum End {
    Done,
    Lost(String),
    Hangs,
}

/// Waits until the first recorder is ready.
///
/// # Errors
/// If it ends, or is not ready within `timeout`.
pub fn await_ready(child: &mut Child, heartbeats: &hapfic_ipc::HeartbeatPage, timeout: Duration) -> Result<()> {
    let begun = Instant::now();
    loop {
        let phase = heartbeats.read(Process::Recorder).phase;
        if matches!(phase, Some(Phase::Ready | Phase::Running)) {
            return Ok(());
        }
        if let Some(end) = child.ended().context("cannot watch the recorder")? {
            anyhow::bail!("the recorder {end} before it was ready");
        }
        anyhow::ensure!(begun.elapsed() < timeout, "the recorder did not get ready within {} s", timeout.as_secs());
        std::thread::sleep(Duration::from_millis(1));
    }
}
