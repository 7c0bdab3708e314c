//! The harness of the tests that start the real stack: builds the binary, runs it in a corner of its own, and looks for what it
//! left behind.
//!
//! A failure here is a failure of the test that uses it, so everything panics with what it was about.
#![allow(clippy::unwrap_used, clippy::expect_used)]

pub mod fuzz;
mod leftovers;
mod stack;

pub use leftovers::{children_of, is_running, remains_of};
pub use stack::{Finished, Stack, Started, hapfic};
