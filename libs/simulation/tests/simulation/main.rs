//! The stack in one process, under random motion and random parameter changes.
//!
//! All random numbers are functions of a seed, which a failure reports. `--nocapture` shows the printed figures.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, missing_docs)]

mod bits;
mod conditions;
mod contact_changes;
mod draw;
mod leg_motion;
mod parameter_changes;
mod passage;
mod repetition;
mod robots;
mod script;
mod workers;
mod worst;
