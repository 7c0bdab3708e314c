//! Errors of messaging and of process set-up.

use hapfic_messages::ValidationError;
use std::path::PathBuf;

/// An error of messaging or of a process's set-up.
#[derive(Debug, thiserror::Error)]
pub enum IpcError {
    /// A call of iceoryx2 failed.
    #[error("cannot {action} '{topic}': {cause}")]
    Messaging {
        /// Attempted action.
        action: &'static str,
        /// The topic or node.
        topic: String,
        /// Cause from iceoryx2.
        cause: String,
    },
    /// A name or path that iceoryx2 cannot use.
    #[error("'{value}' cannot be used as {what}: {cause}")]
    Name {
        /// Required kind of name.
        what: &'static str,
        /// Value given.
        value: String,
        /// Cause from iceoryx2.
        cause: String,
    },
    /// The run file that a process gets from its supervisor.
    #[error("run file {path}: {cause}; it is written by the supervisor, start the stack with `hapfic run`")]
    RunFile {
        /// Path of the file.
        path: PathBuf,
        /// Cause.
        cause: String,
    },
    /// A system call failed.
    #[error("cannot {action}: {cause}")]
    System {
        /// Attempted action.
        action: &'static str,
        /// Cause from the system.
        cause: std::io::Error,
    },
    /// A message that failed its check.
    #[error("message on '{topic}' rejected: {defect}")]
    Message {
        /// The topic.
        topic: &'static str,
        /// Defect of the message.
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
