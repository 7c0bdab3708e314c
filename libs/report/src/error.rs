//! Errors of a report.

use hapfic_log::LogError;
use std::io;
use std::path::PathBuf;

/// Error of a report. Every message names the file, the finding, the expectation and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// The log cannot be opened, or is no log.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The log holds no state.
    #[error("{}: nothing to report: found {found}, expected messages of /state. Give the log of a run that reached its first tick", .path.display())]
    Empty {
        /// The log.
        path: PathBuf,
        /// Content of the log.
        found: String,
    },
    /// The report would replace the log.
    #[error("{}: the {what} would replace the log itself. Give another path", .path.display())]
    SameFile {
        /// The log.
        path: PathBuf,
        /// Part of the report.
        what: &'static str,
    },
    /// The output path of a part of the report is invalid.
    #[error("{}: invalid path for the {what}: found {found}, expected {expected}. Give another path; nothing was written", .path.display())]
    OutputPath {
        /// Output path.
        path: PathBuf,
        /// Part of the report.
        what: &'static str,
        /// Present content of the path.
        found: &'static str,
        /// Expected content of the path.
        expected: &'static str,
    },
    /// A file of the report cannot be written.
    #[error("{}: cannot write the report: {cause}. Give a path in a folder that exists and that you may write to", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        cause: io::Error,
    },
    /// A picture cannot be drawn.
    #[error("{figure}: cannot draw the figure: {cause}. Check the free memory, or request the HTML alone")]
    Draw {
        /// Name of the figure.
        figure: String,
        /// Error of the drawing library.
        cause: String,
    },
}

impl ReportError {
    /// Whether the request itself is invalid, as opposed to a failure of its execution.
    #[must_use]
    pub const fn is_invalid_request(&self) -> bool {
        !matches!(self, Self::Write { .. } | Self::Draw { .. } | Self::Log(LogError::Read { .. }))
    }
}
