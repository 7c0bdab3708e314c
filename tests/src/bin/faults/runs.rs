//! Runs of the stack that end in any case.

use hapfic_tests::{Stack, remains_of};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::fs::File;
use std::path::PathBuf;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// How long a run may take to end after it was asked to.
const TO_END: Duration = Duration::from_secs(10);
/// How often to look whether it has ended: seldom enough not to be in its way.
const POLL_INTERVAL: Duration = Duration::from_millis(10);
/// The log of a run.
pub(crate) const LOG: &str = "run.mcap";
/// Its summary.
const SUMMARY: &str = "run.json";

/// A place for runs, one after the other; everything in it goes with it.
pub(crate) struct Place {
    stack: Stack,
}

/// How a run ended.
pub(crate) struct End {
    /// Its exit code; none if a signal ended it.
    pub(crate) code: Option<i32>,
    /// What it said.
    pub(crate) out: String,
    /// What it said on standard error.
    pub(crate) err: String,
    /// Its summary; null if there is none.
    pub(crate) summary: Value,
    /// It had to be ended.
    pub(crate) hung: bool,
}

impl End {
    /// Whether all its ticks were done.
    pub(crate) fn completed(&self) -> bool {
        self.code == Some(0) && self.summary["completed"] == true
    }

    /// In a word.
    pub(crate) fn word(&self) -> String {
        match self.code {
            _ if self.hung => "**hung**".to_owned(),
            Some(0) if self.completed() => "yes".to_owned(),
            Some(code) => format!("**no**, exit code {code}"),
            None => "**no**, ended by a signal".to_owned(),
        }
    }
}

impl Place {
    pub(crate) fn new() -> Self {
        Self { stack: Stack::new() }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.stack.path(name)
    }

    /// Runs that are still registered.
    pub(crate) fn registrations(&self) -> usize {
        self.stack.registrations()
    }

    /// Starts the program.
    pub(crate) fn start(&self, arguments: &[&str]) -> Running {
        // Files, not pipes: nobody has to read them, and nobody is kept waiting by what a killed run has left.
        let [out, err] = ["out.txt", "err.txt"].map(|name| self.path(name));
        let file = |path: &PathBuf| Stdio::from(File::create(path).expect("a file for what the run says"));
        let child = self.stack.command(arguments).stdout(file(&out)).stderr(file(&err)).spawn().expect("the binary starts");
        Running { child, out, err, summary: self.path(SUMMARY), ended: false }
    }

    /// Runs the program to its end, for so long at most.
    pub(crate) fn run(&self, arguments: &[&str], limit: Duration) -> End {
        let running = self.start(arguments);
        let pid = running.pid();
        let end = running.finish(limit);
        if end.hung && !remains_of(pid).is_empty() {
            // The next start removes what is left of a run that had to be killed.
            let _ =
                self.start(&["run", "floor", "--clock", "lockstep", "--duration", "0.05", "--log", "sweep.mcap"]).finish(TO_END);
        }
        end
    }

    /// Runs the floor scenario with a log and a summary.
    pub(crate) fn floor(&self, clock: &str, duration_s: f64, settings: &[String], limit: Duration) -> End {
        // What an earlier run wrote must not stand for this one.
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

/// A program that runs; ended when dropped.
pub(crate) struct Running {
    child: Child,
    out: PathBuf,
    err: PathBuf,
    summary: PathBuf,
    ended: bool,
}

impl Running {
    pub(crate) fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Whether it has ended.
    pub(crate) fn has_ended(&mut self) -> bool {
        self.ended = self.ended || !matches!(self.child.try_wait(), Ok(None));
        self.ended
    }

    /// Kills it and waits for its end. Returns when, on `CLOCK_MONOTONIC`, ns.
    pub(crate) fn kill(mut self) -> u64 {
        let now = hapfic_ipc::clock::now_ns();
        // One that has ended already is as good.
        let _ = self.child.kill();
        let _ = self.child.wait();
        self.ended = true;
        now
    }

    /// Waits for its end, for so long at most, then ends it.
    pub(crate) fn finish(mut self, limit: Duration) -> End {
        let hung = !self.wait(limit);
        if hung {
            self.end();
        }
        let code = self.child.wait().expect("a status").code();
        self.ended = true;
        let read = |path: &PathBuf| std::fs::read_to_string(path).unwrap_or_default();
        let summary = serde_json::from_str(&read(&self.summary)).unwrap_or(Value::Null);
        End { code, out: read(&self.out), err: read(&self.err), summary, hung }
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

    /// As by Ctrl-C, and if that does not help, by force.
    fn end(&mut self) {
        let _ = kill_process(Pid::from_child(&self.child), Signal::INT);
        if !self.wait(TO_END) {
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
        self.ended = true;
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if !self.has_ended() {
            self.end();
        }
    }
}
