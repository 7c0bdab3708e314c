//! Starting the stack, and what came of it.

use crate::leftovers::{children_of, remains_of};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// How long anything may take before a test gives up. Generous: machines are shared.
const TIMEOUT: Duration = Duration::from_secs(120);

/// The binary, built once by each test process: it is then never older than the sources.
pub fn hapfic() -> PathBuf {
    static BINARY: OnceLock<PathBuf> = OnceLock::new();
    BINARY
        .get_or_init(|| {
            let mut build = Command::new(env!("CARGO"));
            build.args(["build", "--quiet", "-p", "hapfic-cli", "--manifest-path"]);
            build.arg(concat!(env!("CARGO_MANIFEST_DIR"), "/../Cargo.toml"));
            let own = std::env::current_exe().expect("the test's own path");
            let profile = own.ancestors().find(|p| p.ends_with("release") || p.ends_with("debug")).expect("a profile's folder");
            if profile.ends_with("release") {
                build.arg("--release");
            }
            assert!(build.status().expect("cargo").success(), "the binary does not build");
            profile.join("hapfic")
        })
        .clone()
}

/// A place to run the stack in: a folder for logs, and a run-time directory of its own.
#[derive(Debug)]
pub struct Stack {
    folder: TempDir,
}

impl Default for Stack {
    fn default() -> Self {
        Self::new()
    }
}

impl Stack {
    /// A fresh place.
    #[must_use]
    pub fn new() -> Self {
        Self { folder: TempDir::new().expect("a temporary folder") }
    }

    /// A path in the place.
    #[must_use]
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The program with arguments, not started yet.
    #[must_use]
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(hapfic());
        command
            .args(arguments)
            .current_dir(self.folder.path())
            .env("XDG_RUNTIME_DIR", self.folder.path())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    /// Starts the program.
    #[must_use]
    pub fn start(&self, arguments: &[&str]) -> Started {
        Started { child: Some(self.command(arguments).spawn().expect("the binary starts")) }
    }

    /// Runs the program to its end.
    #[must_use]
    pub fn run(&self, arguments: &[&str]) -> Finished {
        self.start(arguments).finish()
    }

    /// What is left in the run-time directory.
    #[must_use]
    pub fn registrations(&self) -> usize {
        std::fs::read_dir(self.path("hapfic")).map_or(0, Iterator::count)
    }
}

/// A program that runs.
#[derive(Debug)]
pub struct Started {
    /// Taken by whoever waits for its end.
    child: Option<Child>,
}

impl Drop for Started {
    /// A test that failed in between leaves nothing running: as by Ctrl-C, and if that does not help, by force.
    fn drop(&mut self) {
        let Some(mut child) = self.child.take() else { return };
        let _ = rustix::process::kill_process(rustix::process::Pid::from_child(&child), rustix::process::Signal::INT);
        let start = Instant::now();
        while matches!(child.try_wait(), Ok(None)) {
            if start.elapsed() > Duration::from_secs(5) {
                let _ = child.kill();
                let _ = child.wait();
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Started {
    fn child(&self) -> &Child {
        self.child.as_ref().expect("it has not ended")
    }

    fn child_mut(&mut self) -> &mut Child {
        self.child.as_mut().expect("it has not ended")
    }

    /// Its process id.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.child().id()
    }

    /// Sends it a signal.
    pub fn signal(&self, signal: rustix::process::Signal) {
        let pid = rustix::process::Pid::from_child(self.child());
        rustix::process::kill_process(pid, signal).expect("the program still runs");
    }

    /// Waits until it has started all its processes, and returns them by name.
    #[must_use]
    pub fn children(&mut self, names: &[&str]) -> Vec<(String, u32)> {
        let start = Instant::now();
        loop {
            let children = children_of(self.pid());
            if names.iter().all(|n| children.iter().any(|(c, _)| c == n)) {
                return children;
            }
            assert!(self.child_mut().try_wait().expect("a status").is_none(), "it has ended before it started {names:?}");
            assert!(start.elapsed() < TIMEOUT, "{names:?} did not all start: {children:?}");
            std::thread::yield_now();
        }
    }

    /// Waits until a file is at least so large.
    pub fn wait_for(&mut self, file: &std::path::Path, bytes: u64) {
        let start = Instant::now();
        while std::fs::metadata(file).map_or(0, |m| m.len()) < bytes {
            assert!(self.child_mut().try_wait().expect("a status").is_none(), "it has ended before {file:?} had {bytes} bytes");
            assert!(start.elapsed() < TIMEOUT, "{file:?} does not grow to {bytes} bytes");
            std::thread::yield_now();
        }
    }

    /// Kills it and waits for its end; what it said is lost, since processes it has left behind may hold on to its output.
    #[must_use]
    pub fn kill(mut self) -> Finished {
        let supervisor = self.pid();
        let mut child = self.child.take().expect("it has not ended");
        child.kill().expect("the program still runs");
        let status = child.wait().expect("a status");
        Finished { supervisor, code: status.code(), out: String::new(), err: String::new() }
    }

    /// Waits for its end.
    #[must_use]
    pub fn finish(mut self) -> Finished {
        let supervisor = self.pid();
        let output = self.child.take().expect("it has not ended").wait_with_output().expect("the program's output");
        Finished {
            supervisor,
            code: output.status.code(),
            out: String::from_utf8_lossy(&output.stdout).into_owned(),
            err: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }
}

/// A program that has ended.
#[derive(Debug)]
pub struct Finished {
    /// Its process id.
    pub supervisor: u32,
    /// Its exit code; none if a signal ended it.
    pub code: Option<i32>,
    /// What it said.
    pub out: String,
    /// What it said on standard error.
    pub err: String,
}

impl Finished {
    /// Asserts the exit code, and that nothing of the run is left.
    pub fn expect(&self, code: i32) -> &Self {
        assert_eq!(self.code, Some(code), "stdout:\n{}\nstderr:\n{}", self.out, self.err);
        self.expect_nothing_left()
    }

    /// Asserts that nothing of the run is left, as soon as what is ending has ended.
    pub fn expect_nothing_left(&self) -> &Self {
        let start = Instant::now();
        loop {
            let remains = remains_of(self.supervisor);
            if remains.is_empty() {
                return self;
            }
            assert!(start.elapsed() < Duration::from_secs(10), "left behind: {remains:?}");
            std::thread::yield_now();
        }
    }
}
