//! What is wrong with a scenario, and where.

use std::fmt;
use std::sync::Arc;

/// Where a value was written.
#[derive(Clone, Debug, Eq, PartialEq)]
pub enum Location {
    /// In a file.
    File {
        /// The file, as the user named it.
        name: Arc<str>,
        /// Counts from 1; none if the complaint is about the file as a whole.
        line: Option<usize>,
    },
    /// On the command line: the `KEY=VALUE` after `--set`.
    Override(Arc<str>),
    /// In a change of a running stack: one `KEY=VALUE` of it.
    Change(Arc<str>),
    /// In a fault for a running stack: one `KEY=VALUE` of it.
    Injection(Arc<str>),
}

impl Location {
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
        }
    }
}

/// The content of a [`ConfigError`].
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Complaint {
    /// Where it was written.
    pub place: Location,
    /// Path of the key, such as `controller.stiffness_n_per_m[1]`; empty if it is about no key.
    pub key: String,
    /// What stands there.
    pub found: String,
    /// What should stand there.
    pub expected: String,
    /// What to do about it.
    pub help: String,
}

impl fmt::Display for Complaint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.place)?;
        if !self.key.is_empty() {
            write!(f, "{}: ", self.key)?;
        }
        write!(f, "found {}, expected {}. Hint: {}", self.found, self.expected, self.help)
    }
}

/// A scenario that cannot be used. Loading stops at the first one.
#[derive(Clone, Debug, Eq, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// The scenario or its robot description cannot be read.
    #[error("{0}")]
    Read(Box<Complaint>),
    /// No embedded scenario has this name.
    #[error("{0}")]
    UnknownScenario(Box<Complaint>),
    /// The text is not TOML, or gives a key twice.
    #[error("{0}")]
    NotToml(Box<Complaint>),
    /// No such key.
    #[error("{0}")]
    UnknownKey(Box<Complaint>),
    /// A required key is absent.
    #[error("{0}")]
    MissingKey(Box<Complaint>),
    /// A value of another type, or a word that is none of the choices.
    #[error("{0}")]
    WrongType(Box<Complaint>),
    /// A number outside its range, or not finite.
    #[error("{0}")]
    OutOfRange(Box<Complaint>),
    /// A list of another length.
    #[error("{0}")]
    WrongLength(Box<Complaint>),
    /// Values that are legal alone and not together.
    #[error("{0}")]
    Combination(Box<Complaint>),
    /// An override that cannot be read or applied.
    #[error("{0}")]
    Override(Box<Complaint>),
}

impl ConfigError {
    /// Location, key, found, expected and what to do, one by one.
    #[must_use]
    pub fn complaint(&self) -> &Complaint {
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

    pub(crate) fn complaint_mut(&mut self) -> &mut Complaint {
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

/// The known word that a misspelt one probably stands for.
pub(crate) fn nearest<'k>(word: &str, known: &[&'k str]) -> Option<&'k str> {
    // 0.8 of Jaro and Winkler's measure takes one or two slips in a name of usual length, and no other word.
    known
        .iter()
        .map(|candidate| (strsim::jaro_winkler(word, candidate), *candidate))
        .filter(|(likeness, _)| *likeness >= 0.8)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, candidate)| candidate)
}
