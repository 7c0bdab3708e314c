//! What can go wrong with a report.

use hapfic_log::LogError;
use std::io;
use std::path::PathBuf;

/// What can go wrong with a report. Every message says which file, what was found, what was expected and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// The log cannot be opened, or is none.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The log holds no state, so there is nothing to show.
    #[error("{}: nothing to report: found {found}, expected messages of /state. Give the log of a run that got as far as its first tick", .path.display())]
    Empty {
        /// The log.
        path: PathBuf,
        /// What it holds instead.
        found: String,
    },
    /// The report would replace its own source.
    #[error("{}: the {what} would replace the log itself. Give another path", .path.display())]
    SameFile {
        /// The log.
        path: PathBuf,
        /// What was to be written.
        what: &'static str,
    },
    /// A part of the report has no place where it is to go.
    #[error("{}: no place for the {what}: found {found}, expected {expected}. Give another path; nothing was written", .path.display())]
    Place {
        /// Where it was to go.
        path: PathBuf,
        /// What was to be written.
        what: &'static str,
        /// What is there.
        found: &'static str,
        /// What should be.
        expected: &'static str,
    },
    /// A file of the report cannot be written.
    #[error("{}: cannot write the report: {cause}. Give a path in a folder that exists and that you may write to", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        cause: io::Error,
    },
    /// A picture cannot be drawn.
    #[error("{figure}: cannot draw the figure: {cause}. Check the memory that is left, or ask for the HTML alone")]
    Draw {
        /// Name of the figure.
        figure: String,
        /// What the drawing said.
        cause: String,
    },
}

impl ReportError {
    /// Whether what was asked for is no good, as opposed to a failure on the way.
    #[must_use]
    pub const fn is_refusal(&self) -> bool {
        !matches!(self, Self::Write { .. } | Self::Draw { .. } | Self::Log(LogError::Read { .. }))
    }
}
