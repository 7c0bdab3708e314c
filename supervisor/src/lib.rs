//! Launches the stack, watches its processes, records everything and answers operators.
//!
//! Read [`launch`] first: one run from start to end. [`watch`] starts, watches and restarts the processes ([`children`]); [`recorder`]
//! drains and writes; [`operator`] answers requests; [`registry`] says where a run lives and finds it again; [`summary`] is what comes
//! of a run.

pub mod children;
pub mod launch;
mod notify;
pub mod operator;
pub mod privileges;
mod progress;
pub mod recorder;
pub mod registry;
mod request;
pub mod summary;
pub mod watch;

pub use request::RunRequest;

/// Writes a line to standard error. A reader that has gone away is no reason to fail.
pub fn say(text: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "{text}");
}
