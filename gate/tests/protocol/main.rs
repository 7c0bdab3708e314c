//! The protocol of gate, controllers and restarts, explored exhaustively: every action of faults, restarts, ticks and operator's
//! inputs within the bounds that `docs/protocol.md` gives.
//!
//! The functions explored are those that run. Each rule is shown to be able to fail by a mutation that breaks it. The numbers of
//! states are printed: see them with `--nocapture`.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, missing_docs)]

mod mutants;
mod mutation;
mod recovery;
mod rules;
mod seat;
mod stack;
mod whole;
