//! Exhaustive exploration of the protocol of gate, controllers and restarts: every order of faults, restarts, ticks and
//! operator inputs, within the bounds that `docs/protocol.md` gives.
//!
//! The explored functions are those that run. For each rule a mutation that breaks it shows that the rule can fail. The
//! tests print the numbers of states: see them with `--nocapture`.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, missing_docs)]

mod mutants;
mod mutation;
mod pair;
mod recovery;
mod rules;
mod slot;
mod stack;
mod whole;
