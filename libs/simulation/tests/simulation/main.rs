//! The whole stack in one process, under what no script would do to it.
//!
//! Everything random is a function of a seed, which a failure names. The figures are printed: see them with `--nocapture`.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, missing_docs)]

mod bits;
mod draw;
mod leg_motion;
mod parameter_changes;
mod repetition;
mod script;
mod workers;
mod worst;
