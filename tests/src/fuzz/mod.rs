//! Fuzzing of every decoder that reads what comes from outside: scenarios, robot descriptions, changes, run files, logs, and the
//! messages of other processes.
//!
//! There is no feedback from coverage: that takes a nightly compiler. In its place an input that is answered in a way not met
//! before joins the inputs that are mutated, where an answer is the text of the refusal without its numbers and quotations. It
//! follows the branches that refuse, and is blind to the others.
//!
//! What counts as a finding: a panic (a [`Target`] asserts what it promises of an input that is accepted), an execution that takes
//! longer than [`SLOW`], and, where each campaign has a process of its own as in the program `fuzz`, an abort, which is what running
//! out of stack or of the memory it is allowed comes to.

mod campaign;
mod corpus;
mod mutate;
mod quiet;
mod shape;
mod target;
mod targets;
mod watch;

pub use campaign::{Budget, Finding, Options, SLOW, Tally, campaign};
pub use corpus::{FOLDER, file_name, load, save};
pub use shape::shape;
pub use target::{FuzzOutcome, Target};
pub use targets::{ALL, named};
