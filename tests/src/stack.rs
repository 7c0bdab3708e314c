//! Start of the stack, and its result.

use crate::leftovers::{children_of, remains_of};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Time-out of every wait of a test. Generous: machines are shared.
const TIMEOUT: Duration = Duration::from_secs(120);

/// Path of the binary. Each test process builds it once, so it is never older than the sources.
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

/// Sandbox of the stack: a temporary folder for logs, which is the run-time directory too.
#[derive(Debug)]
pub struct StackSandbox {
    folder: TempDir,
}

impl Default for StackSandbox {
    fn default() -> Self {
        Self::new()
    }
}

impl StackSandbox {
    /// Makes an empty sandbox.
    #[must_use]
    pub fn new() -> Self {
        Self { folder: TempDir::new().expect("a temporary folder") }
    }

    /// Path in the sandbox.
    #[must_use]
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Command line of the program, not started yet.
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
    pub fn start(&self, arguments: &[&str]) -> StartedProgram {
        StartedProgram { child: Some(self.command(arguments).spawn().expect("the binary starts")) }
    }

    /// Runs the program to its end.
    #[must_use]
    pub fn run(&self, arguments: &[&str]) -> FinishedProgram {
        self.start(arguments).finish()
    }

    /// Number of registrations in the run-time directory.
    #[must_use]
    pub fn registrations(&self) -> usize {
        std::fs::read_dir(self.path("hapfic")).map_or(0, Iterator::count)
    }
}

/// Running program.
#[derive(Debug)]
pub struct StartedProgram {
    /// `None` after the wait for its end.
    child: Option<Child>,
}

impl Drop for StartedProgram {
    /// Ends the program of a failed test with SIGINT, and after 5 s with SIGKILL.
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

impl StartedProgram {
    fn child(&self) -> &Child {
        self.child.as_ref().expect("a running program")
    }

    fn child_mut(&mut self) -> &mut Child {
        self.child.as_mut().expect("a running program")
    }

    /// Process id.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.child().id()
    }

    /// Sends a signal to the program.
    pub fn signal(&self, signal: rustix::process::Signal) {
        let pid = rustix::process::Pid::from_child(self.child());
        rustix::process::kill_process(pid, signal).expect("the program still runs");
    }

    /// Waits until the named processes have started, and returns all children.
    #[must_use]
    pub fn children(&mut self, names: &[&str]) -> Vec<(String, u32)> {
        let start = Instant::now();
        loop {
            let children = children_of(self.pid());
            if names.iter().all(|n| children.iter().any(|(c, _)| c == n)) {
                return children;
            }
            assert!(self.child_mut().try_wait().expect("a status").is_none(), "the program ended before it started {names:?}");
            assert!(start.elapsed() < TIMEOUT, "{names:?} did not all start: {children:?}");
            std::thread::yield_now();
        }
    }

    /// Waits until a file has a number of bytes.
    pub fn wait_for(&mut self, file: &std::path::Path, bytes: u64) {
        let start = Instant::now();
        while std::fs::metadata(file).map_or(0, |m| m.len()) < bytes {
            assert!(
                self.child_mut().try_wait().expect("a status").is_none(),
                "the program ended before {file:?} had {bytes} bytes"
            );
            assert!(start.elapsed() < TIMEOUT, "{file:?} does not grow to {bytes} bytes");
            std::thread::yield_now();
        }
    }

    /// Process id of the supervisor of a run.
    #[must_use]
    pub fn supervisor(&mut self) -> u32 {
        let children = self.children(&["supervisor"]);
        children.into_iter().find(|(name, _)| name == "supervisor").expect("a supervisor").1
    }

    /// Kills launcher and supervisor of a run, without which it ends, and waits for the end of the launcher. Discards the
    /// output, as `kill` does.
    #[must_use]
    pub fn kill_with_supervisor(self) -> FinishedProgram {
        let supervisors: Vec<u32> =
            children_of(self.pid()).into_iter().filter(|(name, _)| name == "supervisor").map(|(_, pid)| pid).collect();
        // The launcher first: it would start another. At once: a supervisor without its launcher ends the run.
        self.signal(rustix::process::Signal::KILL);
        for pid in supervisors.into_iter().filter_map(|pid| rustix::process::Pid::from_raw(pid as i32)) {
            // Fails only if it has ended.
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::KILL);
        }
        self.kill()
    }

    /// Kills the program and waits for its end. Discards the output, since orphans may still hold it open.
    #[must_use]
    pub fn kill(mut self) -> FinishedProgram {
        let launcher = self.pid();
        let mut child = self.child.take().expect("a running program");
        // It may have been killed before.
        let _ = child.kill();
        let status = child.wait().expect("a status");
        FinishedProgram { launcher, code: status.code(), out: String::new(), err: String::new() }
    }

    /// Waits for the end of the program.
    #[must_use]
    pub fn finish(mut self) -> FinishedProgram {
        let launcher = self.pid();
        let output = self.child.take().expect("a running program").wait_with_output().expect("the program's output");
        FinishedProgram {
            launcher,
            code: output.status.code(),
            out: String::from_utf8_lossy(&output.stdout).into_owned(),
            err: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }
}

/// Result of a program that has ended.
#[derive(Debug)]
pub struct FinishedProgram {
    /// Process id.
    pub launcher: u32,
    /// Exit code; `None` if a signal ended the program.
    pub code: Option<i32>,
    /// Standard output.
    pub out: String,
    /// Standard error.
    pub err: String,
}

impl FinishedProgram {
    /// Asserts the exit code, and that no remains of the run are left.
    pub fn expect(&self, code: i32) -> &Self {
        assert_eq!(self.code, Some(code), "stdout:\n{}\nstderr:\n{}", self.out, self.err);
        self.expect_nothing_left()
    }

    /// Asserts that no remains of the run are left; polls for 10 s, since processes may still be ending.
    pub fn expect_nothing_left(&self) -> &Self {
        let start = Instant::now();
        loop {
            let remains = remains_of(self.launcher);
            if remains.is_empty() {
                return self;
            }
            assert!(start.elapsed() < Duration::from_secs(10), "left behind: {remains:?}");
            std::thread::yield_now();
        }
    }
}
