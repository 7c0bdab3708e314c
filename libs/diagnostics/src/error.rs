//! Errors of a chain.

use std::io;

/// Error of a chain, or of its output.
#[derive(Debug, thiserror::Error)]
pub enum LatencyError {
    /// The command line is invalid.
    #[error("{0}")]
    Arguments(String),
    /// The program does not have this kind of chain.
    #[error("--kind {found}: no such kind, expected one of: {expected}")]
    Kind {
        /// Requested kind.
        found: String,
        /// Available kinds.
        expected: String,
    },
    /// An operation of the system or of the transport failed.
    #[error("{kind}: cannot {action}: {cause}")]
    Failed {
        /// Kind of chain.
        kind: String,
        /// The operation.
        action: &'static str,
        /// Cause of the failure.
        cause: io::Error,
    },
    /// A relay did not start.
    #[error("{kind}: relay {stage} printed '{found}', expected 'ready' and its grants")]
    Relay {
        /// Kind of chain.
        kind: String,
        /// Stage of the relay.
        stage: usize,
        /// Its output.
        found: String,
    },
    /// The chain did not warm up.
    #[error("{kind}: found {answered} of {sent} messages answered in {seconds} s, expected {expected} answers in a row")]
    WarmUp {
        /// Kind of chain.
        kind: String,
        /// Number of answers.
        answered: u64,
        /// Number of messages sent.
        sent: u64,
        /// Duration of the attempt [s].
        seconds: u64,
        /// Consecutive answers that end the warm-up.
        expected: u64,
    },
    /// The output of a chain is invalid.
    #[error("invalid output of a chain: {0}")]
    Output(String),
}

impl LatencyError {
    /// Makes the error of a failed operation, for `map_err`.
    pub(crate) fn failed<E: Into<io::Error>>(kind: &str, action: &'static str) -> impl FnOnce(E) -> Self {
        let kind = kind.to_owned();
        move |cause| Self::Failed { kind, action, cause: cause.into() }
    }
}
