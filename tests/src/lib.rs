//! Harness of the tests that start the real stack: builds the binary, runs it in a namespace of its own, and lists its
//! remains.
//!
//! A failure here is a failure of the calling test, so every function panics with its cause.
#![allow(clippy::unwrap_used, clippy::expect_used)]

pub mod fuzz;
mod leftovers;
mod stack;

pub use leftovers::{children_of, is_running, remains_of};
pub use stack::{FinishedProgram, StackSandbox, StartedProgram, hapfic};
