//! Fuzzing of every decoder of outside data: scenarios, robot descriptions, changes, run files, logs, and the messages
//! of other processes.
//!
//! Coverage feedback would take a nightly compiler. Instead, an input with a new rejection joins the inputs that are
//! mutated. The [`shape`] of a rejection is its text without numbers and quotations. So the search follows the
//! rejecting branches, and is blind to the others.
//!
//! Three things count as a finding:
//! - a panic (a [`Target`] asserts what it promises of an accepted input);
//! - an execution that takes longer than [`SLOW`];
//! - an abort, by the end of stack or memory. Only the program `fuzz`, which runs each campaign in its own process,
//!   finds these.

mod campaign;
mod corpus;
mod mutate;
mod quiet;
mod shape;
mod target;
mod targets;
mod watch;

pub use campaign::{Budget, CampaignResult, Finding, Options, SLOW, campaign};
pub use corpus::{FOLDER, file_name, load, save};
pub use shape::shape;
pub use target::{FuzzOutcome, Target};
pub use targets::{ALL, named};
