//! Parts of a log: `run.mcap`, `run.part2.mcap`, `run.part3.mcap`, ... Each is a whole log of its own.

use crate::attachment::Attachment;
use crate::error::LogError;
use crate::names::Names;
use crate::reader::{LogMessage, Reader};
use mcap::MAGIC;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Metadata record of a run, and its key for the number of a part.
pub(crate) const RUN: &str = "hapfic";
pub(crate) const PART: &str = "part";

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

/// Whatever has the name of a later part of the log `first`, in the order of the numbers.
fn later(first: &Path) -> Vec<(u32, PathBuf)> {
    let folder = first.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let named = std::fs::read_dir(folder).into_iter().flatten().flatten().filter_map(|entry| {
        let (of, number) = first_of(Path::new(&entry.file_name()));
        (number > 1 && Some(of.as_os_str()) == first.file_name()).then(|| (number, part_path(first, number)))
    });
    let mut found: Vec<_> = named.collect();
    found.sort_unstable();
    found
}

/// Paths of the parts of a log that are there, in their order. The path of a later part gives that part alone.
///
/// Only regular files count; parts that are missing, and those that a limit of the recorder has removed, are left out.
#[must_use]
pub fn parts(path: &Path) -> Vec<PathBuf> {
    let (first, number) = first_of(path);
    if number > 1 {
        return vec![path.to_owned()];
    }
    let mut parts: Vec<_> = numbered(&first).into_iter().map(|(_, path)| path).collect();
    if parts.len() > 1 && !first.exists() {
        parts.remove(0);
    }
    parts
}

/// Numbers and paths of the parts of the log `first` that are there.
pub(crate) fn numbered(first: &Path) -> Vec<(u32, PathBuf)> {
    let later = later(first).into_iter().filter(|(_, path)| path.is_file());
    core::iter::once((1, first.to_owned())).chain(later).collect()
}

/// Later parts of an earlier log of this name, which a new log in parts may replace.
///
/// # Errors
/// [`LogError::Create`] if one is anything but a log.
pub(crate) fn replaceable(first: &Path) -> Result<Vec<PathBuf>, LogError> {
    let mut found = Vec::new();
    for (_, path) in later(first) {
        let is_log = std::fs::symlink_metadata(&path)
            .is_ok_and(|metadata| metadata.is_file() && (metadata.len() == 0 || begins_as_log(&path)));
        if !is_log {
            let what = "it has the name of a part of the log, and is no log";
            return Err(LogError::Create { path, cause: io::Error::new(io::ErrorKind::AlreadyExists, what) });
        }
        found.push(path);
    }
    Ok(found)
}

fn begins_as_log(path: &Path) -> bool {
    let mut start = [0; MAGIC.len()];
    File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok() && start == MAGIC
}

/// Messages of all parts of a log in their order.
///
/// A damaged part gives its valid messages and an error that names it; the next part follows. A missing part, and a part of
/// another run, are errors, too.
pub struct LogParts {
    reader: Reader,
    run: BTreeMap<String, String>,
    attachments: Vec<Attachment>,
    first: PathBuf,
    /// Number of the present part.
    number: u32,
    rest: std::vec::IntoIter<(u32, PathBuf)>,
    /// Part to read after an error about a gap before it.
    waiting: Option<(u32, PathBuf)>,
    /// Error of a first part that is not a log any more, before the messages of the others.
    pending: Option<LogError>,
    count: usize,
}

impl LogParts {
    /// Opens the parts of a log; one of them has to be readable. Each has all that is needed to read it alone.
    ///
    /// # Errors
    /// As [`Reader::open`], of the first part.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, LogError> {
        let (first, number) = first_of(path.as_ref());
        let files = if number > 1 { Vec::new() } else { later(&first) };
        let rest: Vec<_> = files.into_iter().filter(|(_, path)| path.is_file()).collect();
        let count = 1 + rest.len();
        let mut rest = rest.into_iter();
        let (reader, number, pending) = match Reader::open(&path) {
            Ok(reader) => (reader, number, None),
            Err(error) => {
                let whole = |(number, path): (u32, PathBuf)| {
                    let reader = Reader::open(path).ok()?;
                    let is_part = run_of(&reader).get(PART).is_some_and(|text| *text == number.to_string());
                    is_part.then_some((reader, number))
                };
                match rest.find_map(whole) {
                    Some((reader, number)) => (reader, number, Some(error)),
                    None => return Err(error),
                }
            }
        };
        let run = run_of(&reader);
        // A log that has no parts is not searched for them.
        let (rest, count) = if run.contains_key(PART) { (rest, count) } else { (Vec::new().into_iter(), 1) };
        let attachments = reader.attachments().to_vec();
        Ok(Self { reader, run, attachments, first, number, count, rest, waiting: None, pending })
    }

    /// Number of parts.
    #[must_use]
    pub fn part_count(&self) -> usize {
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

    fn open_next(&mut self) -> Option<Result<(), LogError>> {
        let (number, path) = match self.waiting.take() {
            Some(part) => part,
            None => {
                let (number, path) = self.rest.next()?;
                let expected = self.number + 1;
                self.number = number;
                if number > expected {
                    self.waiting = Some((number, path));
                    return Some(Err(LogError::MissingParts { first: self.first.clone(), from: expected, to: number - 1 }));
                }
                (number, path)
            }
        };
        let reader = match Reader::open(&path) {
            Ok(reader) => reader,
            Err(error) => return Some(Err(error)),
        };
        let mut run = run_of(&reader);
        let numbered = run.get(PART).is_some_and(|text| *text == number.to_string());
        run.insert(PART.to_owned(), self.run.get(PART).cloned().unwrap_or_default());
        if !numbered || run != self.run || reader.attachments() != self.attachments {
            return Some(Err(LogError::ForeignPart { path }));
        }
        self.reader = reader;
        Some(Ok(()))
    }
}

fn run_of(reader: &Reader) -> BTreeMap<String, String> {
    reader.metadata().get(RUN).cloned().unwrap_or_default()
}

impl Iterator for LogParts {
    type Item = Result<LogMessage, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Some(error) = self.pending.take() {
            return Some(Err(error));
        }
        loop {
            if let Some(entry) = self.reader.next() {
                return Some(entry);
            }
            if let Err(error) = self.open_next()? {
                return Some(Err(error));
            }
        }
    }
}
