//! Errors of reading and writing a log.

use std::io;
use std::path::{Path, PathBuf};

/// Error of reading or writing a log. Every message names the file, the place in it, the expectation and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// The file cannot be created.
    #[error("{}: cannot create the log: {cause}. Give a path in a folder that exists and that you may write to", .path.display())]
    Create {
        /// The log.
        path: PathBuf,
        /// Error of the operating system.
        cause: io::Error,
    },
    /// The folder of the file cannot be created.
    #[error("cannot create {}, the log's folder: {cause}", .path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// Error of the operating system.
        cause: io::Error,
    },
    /// Another run is writing the file.
    #[error("{}: another run is writing this log. Give each run a log of its own", .path.display())]
    Busy {
        /// The log.
        path: PathBuf,
    },
    /// The file cannot be written any further.
    #[error("{}: cannot write the log: {cause}. All flushed messages are readable; check the free space on the disk", .path.display())]
    Write {
        /// The log.
        path: PathBuf,
        /// Error of the operating system or the encoder.
        cause: io::Error,
    },
    /// The file cannot be opened.
    #[error("{}: cannot open the log: {cause}. Give the path of a log that exists and that you may read", .path.display())]
    Open {
        /// The log.
        path: PathBuf,
        /// Error of the operating system.
        cause: io::Error,
    },
    /// The file cannot be read any further.
    #[error("{}: cannot read the log at byte {byte}: {cause}. Copy the file to another disk and try again", .path.display())]
    Read {
        /// The log.
        path: PathBuf,
        /// Byte at which reading failed.
        byte: u64,
        /// Error of the operating system.
        cause: io::Error,
    },
    /// The file is not a log.
    #[error("{}: not a log: it starts with {found}, expected the MCAP magic 89 4d 43 41 50 30 0d 0a. Give the path of a .mcap file", .path.display())]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// First bytes of the file, in hexadecimal.
        found: String,
    },
    /// The file ends too early: the run is still active, or its writer was killed.
    #[error("{}: the log is truncated: it ends at byte {byte}, expected a footer at its end. The run is still active or was killed; everything before is usable", .path.display())]
    Truncated {
        /// The log.
        path: PathBuf,
        /// Length of the file.
        byte: u64,
    },
    /// Parts of a log are not there.
    #[error("{}: {} missing: removed by recorder.keep_mb, or moved. The ticks in between are not read", .first.display(), missing(*.from, *.to))]
    MissingParts {
        /// The first part.
        first: PathBuf,
        /// Number of the first missing part.
        from: u32,
        /// Number of the last missing part.
        to: u32,
    },
    /// A file with the name of a part is of another run.
    #[error("{}: found another run, expected a part of the log beside it; it is left out", .path.display())]
    ForeignPart {
        /// The file.
        path: PathBuf,
    },
    /// The content is inconsistent.
    #[error("{}: the log is damaged in the record at byte {byte}: {what}. Everything before it is usable; fetch the file again if there is another copy", .path.display())]
    Damaged {
        /// The log.
        path: PathBuf,
        /// Start of the damaged record or of its chunk.
        byte: u64,
        /// Found and expected content.
        what: String,
    },
}

fn missing(from: u32, to: u32) -> String {
    if from == to { format!("part {from} is") } else { format!("parts {from} to {to} are") }
}

impl LogError {
    /// Converts a write error of the MCAP encoder.
    pub(crate) fn write(path: &Path, error: mcap::McapError) -> Self {
        let cause = match error {
            mcap::McapError::Io(cause) => cause,
            other => io::Error::other(other.to_string()),
        };
        Self::Write { path: path.to_owned(), cause }
    }

    /// Error of an inconsistent record.
    pub(crate) fn damaged(path: &Path, byte: u64, what: impl Into<String>) -> Self {
        Self::Damaged { path: path.to_owned(), byte, what: what.into() }
    }
}
