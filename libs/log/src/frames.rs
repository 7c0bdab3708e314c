//! Sequential records of an MCAP file, each with its first byte.

use crate::error::LogError;
use mcap::MAGIC;
use mcap::records::op;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Longest valid record [bytes]. The writer's chunks are a thousandth of it.
pub(crate) const MAX_RECORD_BYTES: u64 = 64 << 20;

/// Size of opcode and length [bytes].
const HEAD: u64 = 9;
const FOOTER: usize = 20;

/// Reads a file record by record, with one record in memory.
pub(crate) struct Frames<R> {
    source: R,
    path: PathBuf,
    offset: u64,
    done: bool,
}

impl<R: Read> Frames<R> {
    /// Checks that the source is an MCAP file; errors name it `path`.
    pub(crate) fn new(source: R, path: &Path) -> Result<Self, LogError> {
        let mut frames = Self { source, path: path.to_owned(), offset: 0, done: false };
        let mut magic = Vec::new();
        let whole = frames.fill(MAGIC.len() as u64, &mut magic);
        if MAGIC.starts_with(&magic) {
            whole?;
            return Ok(frames);
        }
        let found = magic.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ");
        Err(LogError::NotMcap { path: frames.path, found })
    }

    /// Path of the source in errors.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// First byte of the next record.
    pub(crate) fn offset(&self) -> u64 {
        self.offset
    }

    /// Reads the next record into `body` and returns its opcode; `None` after the footer and the final magic.
    pub(crate) fn read_record(&mut self, body: &mut Vec<u8>) -> Result<Option<u8>, LogError> {
        if self.done {
            return Ok(None);
        }
        let start = self.offset;
        self.fill(HEAD, body)?;
        let opcode = body[0];
        let length = body.iter().skip(1).rev().fold(0_u64, |sum, &byte| (sum << 8) | u64::from(byte));
        // 0x80 and above are extensions of other tools.
        if !(op::HEADER..=op::DATA_END).contains(&opcode) && opcode < 0x80 {
            return Err(self.damaged(start, format!("found opcode {opcode:#04x}, expected 0x01 to 0x0f or 0x80 to 0xff")));
        }
        if length > MAX_RECORD_BYTES {
            return Err(self.damaged(start, format!("found a length of {length} bytes, expected at most {MAX_RECORD_BYTES}")));
        }
        self.fill(length, body)?;
        if opcode == op::FOOTER {
            self.end(start, body)?;
        }
        Ok(Some(opcode))
    }

    /// Checks footer and final magic.
    fn end(&mut self, start: u64, footer: &[u8]) -> Result<(), LogError> {
        if footer.len() != FOOTER {
            return Err(self.damaged(start, format!("found a footer of {} bytes, expected {FOOTER}", footer.len())));
        }
        let mut magic = Vec::new();
        self.fill(MAGIC.len() as u64, &mut magic)?;
        if magic != MAGIC {
            return Err(self.damaged(start, "found other bytes after the footer, expected the MCAP magic"));
        }
        self.done = true;
        Ok(())
    }

    /// Reads exactly `length` bytes. Memory grows with the bytes read, so a damaged length allocates nothing.
    fn fill(&mut self, length: u64, body: &mut Vec<u8>) -> Result<(), LogError> {
        body.clear();
        let result = self.source.by_ref().take(length).read_to_end(body);
        let start = self.offset;
        self.offset += body.len() as u64;
        match result {
            Err(cause) => Err(LogError::Read { path: self.path.clone(), byte: start, cause }),
            Ok(_) if (body.len() as u64) < length => Err(LogError::Truncated { path: self.path.clone(), byte: self.offset }),
            Ok(_) => Ok(()),
        }
    }

    fn damaged(&self, byte: u64, what: impl Into<String>) -> LogError {
        LogError::damaged(&self.path, byte, what)
    }
}
