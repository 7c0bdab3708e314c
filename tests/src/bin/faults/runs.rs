//! Runs of the stack with a time limit.

use hapfic_tests::{StackSandbox, children_of, remains_of};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::fs::File;
use std::path::PathBuf;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// Time-out of the end of a run after a signal.
const END_TIMEOUT: Duration = Duration::from_secs(10);
/// Interval of the checks for its end: long enough not to disturb the run.
const POLL_INTERVAL: Duration = Duration::from_millis(10);
/// Log of a run.
pub(crate) const LOG: &str = "run.mcap";
/// Summary of a run.
const SUMMARY: &str = "run.json";

/// Temporary folder for consecutive runs, removed when dropped.
pub(crate) struct RunFolder {
    stack: StackSandbox,
}

/// Result of a run.
pub(crate) struct RunResult {
    /// Exit code; `None` if a signal ended the run.
    pub(crate) code: Option<i32>,
    /// Standard output.
    pub(crate) out: String,
    /// Standard error.
    pub(crate) err: String,
    /// Summary; null if there is none.
    pub(crate) summary: Value,
    /// Whether the run exceeded its time limit.
    pub(crate) hung: bool,
}

impl RunResult {
    /// Whether the run completed all its ticks.
    pub(crate) fn completed(&self) -> bool {
        self.code == Some(0) && self.summary["completed"] == true
    }

    /// Result in a few words, as a table cell.
    pub(crate) fn outcome_text(&self) -> String {
        match self.code {
            _ if self.hung => "**hung**".to_owned(),
            Some(0) if self.completed() => "yes".to_owned(),
            Some(code) => format!("**no**, exit code {code}"),
            None => "**no**, ended by a signal".to_owned(),
        }
    }
}

impl RunFolder {
    pub(crate) fn new() -> Self {
        Self { stack: StackSandbox::new() }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.stack.path(name)
    }

    /// Number of registered runs.
    pub(crate) fn registrations(&self) -> usize {
        self.stack.registrations()
    }

    /// Starts the program.
    pub(crate) fn start(&self, arguments: &[&str]) -> RunningProgram {
        // Files instead of pipes: no reader is needed, and orphans of a killed run cannot block one.
        let [out, err] = ["out.txt", "err.txt"].map(|name| self.path(name));
        let file = |path: &PathBuf| Stdio::from(File::create(path).expect("a file for the run's output"));
        let child = self.stack.command(arguments).stdout(file(&out)).stderr(file(&err)).spawn().expect("the binary starts");
        RunningProgram { child, out, err, summary: self.path(SUMMARY), ended: false }
    }

    /// Runs the program to its end, or to a time limit.
    pub(crate) fn run(&self, arguments: &[&str], limit: Duration) -> RunResult {
        let running = self.start(arguments);
        let pid = running.pid();
        let end = running.finish(limit);
        if end.hung && !remains_of(pid).is_empty() {
            // The next start removes the remains of a killed run.
            let _ = self
                .start(&["run", "floor", "--clock", "lockstep", "--duration", "0.05", "--log", "clean_up.mcap"])
                .finish(END_TIMEOUT);
        }
        end
    }

    /// Runs the floor scenario with a log and a summary.
    pub(crate) fn floor(&self, clock: &str, duration_s: f64, settings: &[String], limit: Duration) -> RunResult {
        // Removes the files of an earlier run.
        for written in [LOG, SUMMARY] {
            let _ = std::fs::remove_file(self.path(written));
        }
        let duration = format!("{duration_s:?}");
        let mut arguments =
            vec!["run", "floor", "--clock", clock, "--duration", duration.as_str(), "--log", LOG, "--summary-json", SUMMARY];
        for setting in settings {
            arguments.extend(["--set", setting.as_str()]);
        }
        self.run(&arguments, limit)
    }
}

/// Running program; ended when dropped.
pub(crate) struct RunningProgram {
    child: Child,
    out: PathBuf,
    err: PathBuf,
    summary: PathBuf,
    ended: bool,
}

impl RunningProgram {
    pub(crate) fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Whether the program has ended.
    pub(crate) fn has_ended(&mut self) -> bool {
        self.ended = self.ended || !matches!(self.child.try_wait(), Ok(None));
        self.ended
    }

    /// Kills launcher and supervisor, and waits for the end of the launcher. Returns the time of the kill on
    /// `CLOCK_MONOTONIC` [ns].
    pub(crate) fn kill_with_supervisor(mut self) -> u64 {
        let supervisor = children_of(self.pid()).into_iter().find(|(name, _)| name == "supervisor");
        let now = hapfic_ipc::clock::now_ns();
        // Both may have ended already.
        let _ = self.child.kill();
        if let Some(pid) = supervisor.and_then(|(_, pid)| Pid::from_raw(pid as i32)) {
            let _ = kill_process(pid, Signal::KILL);
        }
        let _ = self.child.wait();
        self.ended = true;
        now
    }

    /// Waits for the end of the program, and ends it after a time limit.
    pub(crate) fn finish(mut self, limit: Duration) -> RunResult {
        let hung = !self.wait(limit);
        if hung {
            self.end();
        }
        let code = self.child.wait().expect("a status").code();
        self.ended = true;
        let read = |path: &PathBuf| std::fs::read_to_string(path).unwrap_or_default();
        let summary = serde_json::from_str(&read(&self.summary)).unwrap_or(Value::Null);
        RunResult { code, out: read(&self.out), err: read(&self.err), summary, hung }
    }

    fn wait(&mut self, limit: Duration) -> bool {
        let begun = Instant::now();
        while !self.has_ended() {
            if begun.elapsed() > limit {
                return false;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
        true
    }

    /// Ends the program by SIGINT, and after a time-out by SIGKILL.
    fn end(&mut self) {
        let _ = kill_process(Pid::from_child(&self.child), Signal::INT);
        if !self.wait(END_TIMEOUT) {
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
        self.ended = true;
    }
}

impl Drop for RunningProgram {
    fn drop(&mut self) {
        if !self.has_ended() {
            self.end();
        }
    }
}
