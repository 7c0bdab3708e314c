//! Tests of the whole stack: real processes, real signals, real files.
//!
//! Tests run in parallel, each in a namespace of its own. Realtime tests run one at a time (a lock file). No test
//! asserts a time.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stderr, missing_docs)]

mod bad_input;
mod command_line;
mod ending;
mod faults;
mod findings;
mod hygiene;
mod lockstep;
mod log_file;
mod online;
mod outputs;
mod python_page;
mod readme;
mod realtime;
mod recover;
mod running;
mod security;
mod simulate;
mod watching;
