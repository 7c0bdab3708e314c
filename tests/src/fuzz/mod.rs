//! Fuzzing of every decoder of outside data: scenarios, robot descriptions, changes, run files, logs, and the messages
//! of other processes.
//!
//! Coverage feedback needs a nightly compiler. Instead, an input with a new rejection joins the inputs that are
//! mutated. The [`shape`] of a rejection is its text without numbers and quotations. So the search follows the
//! rejecting branches, not the others.
//!
//! Findings:
//! - a panic (a [`FuzzTarget`] asserts the properties of an accepted input);
//! - an execution that takes longer than [`SLOW`];
//! - an abort after stack or memory is exhausted. Only the program `fuzz`, which runs each campaign in its own process,
//!   finds these.

mod campaign;
mod corpus;
mod mutate;
mod quiet;
mod shape;
mod target;
mod targets;
mod watch;

pub use campaign::{CampaignBudget, CampaignOptions, CampaignResult, Finding, SLOW, campaign};
pub use corpus::{CORPUS_FOLDER, file_name, load, save};
pub use shape::shape;
pub use target::{FuzzOutcome, FuzzTarget};
pub use targets::{ALL_TARGETS, target_named};
