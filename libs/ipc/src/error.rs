//! What can go wrong between processes.

use hapfic_messages::ValidationError;
use std::path::PathBuf;

/// An error of messaging or of a process's set-up.
#[derive(Debug, thiserror::Error)]
pub enum IpcError {
    /// iceoryx2 rejected.
    #[error("cannot {action} '{topic}': {cause}")]
    Messaging {
        /// What was tried.
        action: &'static str,
        /// The topic or node.
        topic: String,
        /// What iceoryx2 said.
        cause: String,
    },
    /// A name or path that iceoryx2 cannot use.
    #[error("'{value}' cannot be used as {what}: {cause}")]
    Name {
        /// What it should be.
        what: &'static str,
        /// What was given.
        value: String,
        /// Why not.
        cause: String,
    },
    /// The run file that a process gets from its supervisor.
    #[error("run file {path}: {cause}; it is written by the supervisor, start the stack with `hapfic run`")]
    RunFile {
        /// Where.
        path: PathBuf,
        /// What is wrong.
        cause: String,
    },
    /// The operating system rejected.
    #[error("cannot {action}: {cause}")]
    System {
        /// What was tried.
        action: &'static str,
        /// What it said.
        cause: std::io::Error,
    },
    /// A message that a process must not use.
    #[error("message on '{topic}' rejected: {defect}")]
    Message {
        /// The topic.
        topic: &'static str,
        /// What is wrong with it.
        defect: ValidationError,
    },
    /// A sender with no loan left.
    #[error("'{topic}': no memory left to send from")]
    NoLoan {
        /// The topic.
        topic: &'static str,
    },
}

impl IpcError {
    pub(crate) fn messaging(action: &'static str, topic: &str, cause: impl core::fmt::Debug) -> Self {
        Self::Messaging { action, topic: topic.to_owned(), cause: format!("{cause:?}") }
    }
}
