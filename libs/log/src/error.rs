//! What can go wrong with a log.

use std::io;
use std::path::{Path, PathBuf};

/// What can go wrong with a log. Every message says which file, where in it, what was expected and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// The file cannot be created.
    #[error("{}: cannot create the log: {cause}. Give a path in a folder that exists and that you may write to", .path.display())]
    Create {
        /// The log.
        path: PathBuf,
        /// What the operating system said.
        cause: io::Error,
    },
    /// The folder of the file cannot be made.
    #[error("cannot make {}, the log's folder: {cause}", .path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the operating system said.
        cause: io::Error,
    },
    /// Another run is writing the file.
    #[error("{}: another run is writing this log. Give each run a log of its own", .path.display())]
    Busy {
        /// The log.
        path: PathBuf,
    },
    /// The file cannot be written any further.
    #[error("{}: cannot write the log: {cause}. What was flushed before can still be read; check the space left on the disk", .path.display())]
    Write {
        /// The log.
        path: PathBuf,
        /// What the operating system or the encoder said.
        cause: io::Error,
    },
    /// The file cannot be opened.
    #[error("{}: cannot open the log: {cause}. Give the path of a log that exists and that you may read", .path.display())]
    Open {
        /// The log.
        path: PathBuf,
        /// What the operating system said.
        cause: io::Error,
    },
    /// The file cannot be read any further.
    #[error("{}: cannot read the log at byte {byte}: {cause}. Copy the file to another disk and try again", .path.display())]
    Read {
        /// The log.
        path: PathBuf,
        /// Where reading failed.
        byte: u64,
        /// What the operating system said.
        cause: io::Error,
    },
    /// The file is something else.
    #[error("{}: not a log: it starts with {found}, expected the MCAP magic 89 4d 43 41 50 30 0d 0a. Give the path of a .mcap file", .path.display())]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// Its first bytes, in hexadecimal.
        found: String,
    },
    /// The file ends too early: the run is not over, or its writer was killed.
    #[error("{}: the log is truncated: it ends at byte {byte}, expected a footer at its end. The run goes on still or was killed; everything before is usable", .path.display())]
    Truncated {
        /// The log.
        path: PathBuf,
        /// Length of the file.
        byte: u64,
    },
    /// The content contradicts itself.
    #[error("{}: the log is damaged in the record at byte {byte}: {what}. Everything before it is usable; fetch the file again if there is another copy", .path.display())]
    Damaged {
        /// The log.
        path: PathBuf,
        /// Where the damaged record, or the chunk with it, begins.
        byte: u64,
        /// What was found, and what was expected.
        what: String,
    },
}

impl LogError {
    /// A failure to write, as the MCAP encoder reports it.
    pub(crate) fn write(path: &Path, error: mcap::McapError) -> Self {
        let cause = match error {
            mcap::McapError::Io(cause) => cause,
            other => io::Error::other(other.to_string()),
        };
        Self::Write { path: path.to_owned(), cause }
    }

    /// A record that contradicts itself.
    pub(crate) fn damaged(path: &Path, byte: u64, what: impl Into<String>) -> Self {
        Self::Damaged { path: path.to_owned(), byte, what: what.into() }
    }
}
