//! Errors of a recovery.

use crate::error::LogError;
use std::io;
use std::path::PathBuf;

/// Error of a recovery. The original is unchanged, and no new log remains.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecoverError {
    /// The log cannot be read, or the new log cannot be created.
    #[error(transparent)]
    Log(#[from] LogError),
    /// A run has the log open.
    #[error("{}: still being written, expected the log of a run that has ended. Wait for its end, or stop it", .path.display())]
    StillWritten {
        /// The log.
        path: PathBuf,
    },
    /// The new log would replace a file.
    #[error("{}: this file exists already, expected a free name. Remove it, or give another with --output", .path.display())]
    Exists {
        /// The new log.
        path: PathBuf,
    },
    /// The new log would replace the original.
    #[error("{}: the output is the log itself, expected another file: the original is never changed. Give another with --output", .path.display())]
    SameFile {
        /// The log.
        path: PathBuf,
    },
    /// The log has no readable record.
    #[error("{}: nothing to recover: found no message, attachment or metadata in it, expected at least one. Its run ended before the first flush", .path.display())]
    Nothing {
        /// The log.
        path: PathBuf,
    },
    /// The new log cannot be written.
    #[error("{}: cannot write the recovered log: {cause}. The new log was removed and the original is unchanged; check the free space on the disk, or give another path with --output", .path.display())]
    Write {
        /// The new log.
        path: PathBuf,
        /// Error of the operating system or the encoder.
        cause: io::Error,
    },
}

impl RecoverError {
    /// Whether the request itself is invalid, as opposed to a failure of its execution.
    #[must_use]
    pub const fn is_invalid_request(&self) -> bool {
        !matches!(self, Self::Write { .. } | Self::Log(LogError::Read { .. } | LogError::Write { .. }))
    }
}
