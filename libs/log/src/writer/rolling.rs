//! Parts of a log as it is written: when the present one is large enough the next begins, and the oldest may go.

use super::file::OpenFile;
use super::{Writer, WriterOptions, close};
use crate::attachment::Attachment;
use crate::error::LogError;
use crate::parts::{PART, RUN, part_path};
use crate::topic::Topic;
use std::collections::{BTreeMap, VecDeque};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// What the next part of a log needs.
pub(super) struct Parts<W: Write> {
    pub(super) header: Vec<(String, BTreeMap<String, String>)>,
    pub(super) attachments: Vec<Attachment>,
    pub(super) options: WriterOptions,
    pub(super) first: PathBuf,
    /// Opens the file of a part.
    pub(super) open: fn(&Path) -> Result<OpenFile<W>, LogError>,
    /// Number of the present part.
    pub(super) number: u32,
    /// Finished parts that are there: path and size [bytes].
    pub(super) finished: VecDeque<(PathBuf, u64)>,
    pub(super) finished_bytes: u64,
    pub(super) removed: u32,
    /// The last two parameter sets, with their ticks: every part begins with those that may be in force.
    pub(super) sets: VecDeque<(i64, Vec<u8>)>,
}

/// Writes the number of a part into the record of the run.
pub(super) fn number_part(header: &mut Vec<(String, BTreeMap<String, String>)>, number: u32) {
    let pair = (PART.to_owned(), number.to_string());
    match header.iter_mut().find(|(name, _)| name == RUN) {
        Some((_, record)) => {
            record.insert(pair.0, pair.1);
        }
        None => header.push((RUN.to_owned(), BTreeMap::from([pair]))),
    }
}

impl<W: Write> Writer<W> {
    /// Finishes the present part and begins the next, with the parameter sets that may be in force.
    pub(super) fn next_part(&mut self) -> Result<(), LogError> {
        let Some(mut parts) = self.parts.take() else { return Ok(()) };
        let done = self.roll(&mut parts);
        // Also after an error: the totals count what was written.
        self.parts = Some(parts);
        done
    }

    fn roll(&mut self, parts: &mut Parts<W>) -> Result<(), LogError> {
        let path = part_path(&parts.first, parts.number + 1);
        let mut header = parts.header.clone();
        number_part(&mut header, parts.number + 1);
        let (output, disk) = (parts.open)(&path)?;
        let next = Self::new(output, &path, &self.names, &header, &parts.attachments, &parts.options).inspect_err(|_| {
            // A part without a beginning says nothing.
            let _ = std::fs::remove_file(&path);
        })?;
        parts.number += 1;
        let Self { mcap, path: finished, part_bytes, .. } =
            std::mem::replace(self, Self { disk, messages: self.messages, message_bytes: self.message_bytes, ..next });
        close(mcap, &finished)?;
        let size = part_bytes.load(Ordering::Relaxed);
        parts.finished.push_back((finished, size));
        parts.finished_bytes += size;
        for (tick, set) in &parts.sets {
            let at = self.time_of(*tick);
            self.write(Topic::Operator, *tick, at, set)?;
        }
        if let Some(keep) = parts.options.keep_bytes {
            let mut there: u64 = parts.finished.iter().map(|(_, size)| size).sum();
            // The first part is the start of the run, and stays.
            while there + parts.options.part_bytes.unwrap_or(0) > keep && parts.finished.len() > 1 {
                let Some((old, size)) = parts.finished.remove(1) else { break };
                match std::fs::remove_file(&old) {
                    Err(cause) if cause.kind() != io::ErrorKind::NotFound => return Err(LogError::Write { path: old, cause }),
                    _ => {}
                }
                there -= size;
                parts.removed += 1;
            }
        }
        Ok(())
    }
}

/// Size of all parts [bytes]; number of parts, and of those that were removed.
pub(super) fn totals<W: Write>(parts: Option<&Parts<W>>, part_bytes: &AtomicU64) -> (u64, [u32; 2]) {
    let (before, counts) = parts.map_or((0, [1, 0]), |parts| (parts.finished_bytes, [parts.number, parts.removed]));
    (before + part_bytes.load(Ordering::Relaxed), counts)
}
