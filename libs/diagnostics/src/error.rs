//! What can go wrong with a chain.

use std::io;

/// An error of a chain, or of what one said.
#[derive(Debug, thiserror::Error)]
pub enum LatencyError {
    /// The command line.
    #[error("{0}")]
    Arguments(String),
    /// A kind of chain that the program does not have.
    #[error("--kind {found}: no such kind, expected one of: {expected}")]
    Kind {
        /// What was asked for.
        found: String,
        /// What there is.
        expected: String,
    },
    /// The system, or what the chain is made of, rejected.
    #[error("{kind}: cannot {action}: {cause}")]
    Failed {
        /// The kind of chain.
        kind: String,
        /// What was tried.
        action: &'static str,
        /// What it said.
        cause: io::Error,
    },
    /// A relay did not come up.
    #[error("{kind}: relay {place} said '{found}', expected 'ready' and what it was granted")]
    Relay {
        /// The kind of chain.
        kind: String,
        /// Its place.
        place: usize,
        /// What it said.
        found: String,
    },
    /// Nothing comes round.
    #[error("{kind}: {answered} of {sent} messages came round in {seconds} s, expected {wanted} one after the other")]
    Cold {
        /// The kind of chain.
        kind: String,
        /// Answers.
        answered: u64,
        /// Messages sent.
        sent: u64,
        /// How long it was tried, s.
        seconds: u64,
        /// Answers in a row that make a chain warm.
        wanted: u64,
    },
    /// What a program said of its chain cannot be used.
    #[error("what the chain said cannot be used: {0}")]
    Said(String),
}

impl LatencyError {
    /// For `map_err`.
    pub(crate) fn failed<E: Into<io::Error>>(kind: &str, action: &'static str) -> impl FnOnce(E) -> Self {
        let kind = kind.to_owned();
        move |cause| Self::Failed { kind, action, cause: cause.into() }
    }
}
