//! The stack as its users meet it: real processes, real signals, real files.
//!
//! Tests run beside each other, each in a corner of its own; those in realtime one after the other (a lock file), and none
//! asserts a time.
#![allow(clippy::unwrap_used, clippy::expect_used, missing_docs)]

mod bad_input;
mod command_line;
mod ending;
mod faults;
mod hygiene;
mod lockstep;
mod log_file;
mod online;
mod readme;
mod realtime;
mod recover;
mod running;
mod security;
mod simulate;
