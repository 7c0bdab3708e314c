//! Launches the stack, watches its processes, records all messages and answers operators.
//!
//! Read [`launch`] first: the launcher, which starts the supervisor and replaces a lost one; then [`supervise`]: a run from
//! start to end. [`watch`] starts, watches and restarts the processes ([`children`]);
//! [`recorder`] drains and writes the messages, in a process of its own; [`operator`] answers requests. [`registry`] holds the namespace of a
//! run and finds running stacks; [`summary`] holds the results of a run.

pub mod children;
mod latest;
pub mod launch;
mod notify;
pub mod operator;
mod preflight;
pub mod privileges;
mod progress;
mod reaper;
pub mod recorder;
pub mod registry;
mod request;
pub mod summary;
pub mod supervise;
pub mod watch;

pub use request::RunRequest;

/// Writes a line to standard error; a closed standard error is no failure.
pub fn log_line(text: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "{text}");
}
