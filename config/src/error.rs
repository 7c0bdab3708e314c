//! Errors of scenarios, with their places.

use std::fmt;
use std::sync::Arc;

/// Place of a value.
#[derive(Clone, Debug, Eq, PartialEq)]
pub enum Location {
    /// In a file.
    File {
        /// The file, as given by the user.
        name: Arc<str>,
        /// Line, from 1; `None` if the error concerns the file as a whole.
        line: Option<usize>,
    },
    /// On the command line: the `KEY=VALUE` after `--set`.
    Override(Arc<str>),
    /// In a change of a running stack: a `KEY=VALUE` of it.
    Change(Arc<str>),
    /// In a fault for a running stack: a `KEY=VALUE` of it.
    Injection(Arc<str>),
    /// In a query of a running stack: a `KEY` of it.
    Query(Arc<str>),
}

impl Location {
    /// Line in a file, from 1; `None` for a file as a whole and for the command line.
    #[must_use]
    pub fn line(&self) -> Option<usize> {
        match self {
            Self::File { line, .. } => *line,
            Self::Override(_) | Self::Change(_) | Self::Injection(_) | Self::Query(_) => None,
        }
    }

    /// A whole file.
    pub(crate) fn whole(name: &str) -> Self {
        Self::File { name: name.into(), line: None }
    }
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File { name, line: Some(line) } => write!(f, "{name}:{line}"),
            Self::File { name, line: None } => f.write_str(name),
            Self::Override(argument) => write!(f, "--set {argument}"),
            Self::Change(argument) => write!(f, "set {argument}"),
            Self::Injection(argument) => write!(f, "inject {argument}"),
            Self::Query(argument) => write!(f, "get {argument}"),
        }
    }
}

/// Content of a [`ConfigError`].
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Diagnostic {
    /// Place of the value.
    pub place: Location,
    /// Path of the key, such as `controller.stiffness_n_per_m[1]`; empty if the error concerns no key.
    pub key: String,
    /// Value found.
    pub found: String,
    /// Value expected.
    pub expected: String,
    /// Hint at the correction.
    pub help: String,
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.place)?;
        if !self.key.is_empty() {
            write!(f, "{}: ", self.key)?;
        }
        write!(f, "found {}, expected {}. Hint: {}", self.found, self.expected, self.help)
    }
}

/// A scenario is invalid. Loading stops at the first error.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// The scenario or its robot description cannot be read.
    #[error("{0}")]
    Read(Box<Diagnostic>),
    /// No embedded scenario has this name.
    #[error("{0}")]
    UnknownScenario(Box<Diagnostic>),
    /// The text is not TOML, or repeats a key.
    #[error("{0}")]
    NotToml(Box<Diagnostic>),
    /// A key is unknown.
    #[error("{0}")]
    UnknownKey(Box<Diagnostic>),
    /// A required key is missing.
    #[error("{0}")]
    MissingKey(Box<Diagnostic>),
    /// A value has another type, or a word is none of the choices.
    #[error("{0}")]
    WrongType(Box<Diagnostic>),
    /// A number is outside its range, or not finite.
    #[error("{0}")]
    OutOfRange(Box<Diagnostic>),
    /// A list has another length.
    #[error("{0}")]
    WrongLength(Box<Diagnostic>),
    /// Values are valid alone but not together.
    #[error("{0}")]
    Combination(Box<Diagnostic>),
    /// An override cannot be read or applied.
    #[error("{0}")]
    Override(Box<Diagnostic>),
}

impl ConfigError {
    /// Returns place, key, found, expected and hint.
    #[must_use]
    pub fn diagnostic(&self) -> &Diagnostic {
        match self {
            Self::Read(c)
            | Self::UnknownScenario(c)
            | Self::NotToml(c)
            | Self::UnknownKey(c)
            | Self::MissingKey(c)
            | Self::WrongType(c)
            | Self::OutOfRange(c)
            | Self::WrongLength(c)
            | Self::Combination(c)
            | Self::Override(c) => c,
        }
    }

    pub(crate) fn diagnostic_mut(&mut self) -> &mut Diagnostic {
        match self {
            Self::Read(c)
            | Self::UnknownScenario(c)
            | Self::NotToml(c)
            | Self::UnknownKey(c)
            | Self::MissingKey(c)
            | Self::WrongType(c)
            | Self::OutOfRange(c)
            | Self::WrongLength(c)
            | Self::Combination(c)
            | Self::Override(c) => c,
        }
    }
}

/// Returns the known word that is most similar to a misspelt one, if any is similar enough.
pub(crate) fn nearest<'k>(word: &str, known: &[&'k str]) -> Option<&'k str> {
    // A Jaro-Winkler similarity of 0.8 accepts one or two typing errors in a name of usual length, and no other word.
    known
        .iter()
        .map(|candidate| (strsim::jaro_winkler(word, candidate), *candidate))
        .filter(|(similarity, _)| *similarity >= 0.8)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, candidate)| candidate)
}
