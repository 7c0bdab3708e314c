//! Parts of a log: `run.mcap`, `run.part2.mcap`, `run.part3.mcap`, ... Each is a whole log of its own.

use crate::error::LogError;
use crate::names::Names;
use crate::reader::{LogMessage, Reader};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Path of a part by its number, from 1 on; `first` is the path of the first.
#[must_use]
pub fn part_path(first: &Path, number: u32) -> PathBuf {
    if number <= 1 { first.to_owned() } else { first.with_extension(format!("part{number}.mcap")) }
}

/// The first part, and the number, of the part at `path`.
fn first_of(path: &Path) -> (PathBuf, u32) {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let split = stem.rsplit_once(".part").and_then(|(name, number)| Some((name, number.parse().ok()?)));
    match split {
        Some((name, number)) if number > 1 => (path.with_file_name(format!("{name}.mcap")), number),
        _ => (path.to_owned(), 1),
    }
}

/// Paths of the parts of a log that are there, in their order. The path of a later part gives that part alone.
///
/// Parts that a limit of the recorder has removed are left out; a log without parts gives itself.
#[must_use]
pub fn parts(path: &Path) -> Vec<PathBuf> {
    let (first, number) = first_of(path);
    if number > 1 {
        return vec![path.to_owned()];
    }
    let mut numbers: Vec<u32> = Vec::new();
    let folder = match first.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    };
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let (of, number) = first_of(Path::new(&entry.file_name()));
        if number > 1 && Some(of.as_os_str()) == first.file_name() {
            numbers.push(number);
        }
    }
    numbers.sort_unstable();
    core::iter::once(first.clone()).chain(numbers.into_iter().map(|number| part_path(&first, number))).collect()
}

/// Messages of all parts of a log in their order.
///
/// A damaged part gives its valid messages and an error that names it; the next part follows.
pub struct LogParts {
    reader: Reader,
    rest: std::vec::IntoIter<PathBuf>,
    count: usize,
}

impl LogParts {
    /// Opens the parts of a log; only the first has to be readable.
    ///
    /// # Errors
    /// As [`Reader::open`].
    pub fn open(path: impl AsRef<Path>) -> Result<Self, LogError> {
        let paths = parts(path.as_ref());
        let count = paths.len();
        let mut rest = paths.into_iter();
        let first = rest.next().unwrap_or_else(|| path.as_ref().to_owned());
        Ok(Self { reader: Reader::open(first)?, rest, count })
    }

    /// Number of parts.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Metadata of the present part, as [`Reader::metadata`].
    #[must_use]
    pub fn metadata(&self) -> &BTreeMap<String, BTreeMap<String, String>> {
        self.reader.metadata()
    }

    /// Names, as [`Reader::names`].
    #[must_use]
    pub fn names(&self) -> Names {
        self.reader.names()
    }
}

impl Iterator for LogParts {
    type Item = Result<LogMessage, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(entry) = self.reader.next() {
                return Some(entry);
            }
            match Reader::open(self.rest.next()?) {
                Ok(reader) => self.reader = reader,
                Err(error) => return Some(Err(error)),
            }
        }
    }
}
