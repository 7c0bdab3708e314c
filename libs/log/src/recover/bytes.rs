//! Random access to the damaged file, and the fields of its records.

use super::error::RecoverError;
use crate::error::LogError;
use std::fs::{File, TryLockError};
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// Size of a record's opcode and length [bytes].
pub(super) const HEAD: u64 = 9;

/// Read-only file with random access. Its lock prevents runs from writing it.
pub(super) struct SourceFile {
    file: File,
    path: PathBuf,
    length: u64,
}

impl SourceFile {
    pub(super) fn open(path: &Path) -> Result<Self, RecoverError> {
        let failed = |cause| LogError::Open { path: path.to_owned(), cause };
        let file = File::open(path).map_err(failed)?;
        let metadata = file.metadata().map_err(failed)?;
        if !metadata.is_file() {
            return Err(failed(io::Error::new(io::ErrorKind::InvalidInput, "it is not a regular file")).into());
        }
        match file.try_lock_shared() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(RecoverError::StillWritten { path: path.to_owned() }),
            Err(TryLockError::Error(cause)) => return Err(failed(cause).into()),
        }
        // Read only with the lock: before, a run may have appended.
        let length = file.metadata().map_err(failed)?.len();
        Ok(Self { file, path: path.to_owned(), length })
    }

    pub(super) fn file(&self) -> &File {
        &self.file
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Length of the file [bytes].
    pub(super) fn length(&self) -> u64 {
        self.length
    }

    /// Reads `length` bytes from `at` on, or fewer at the end of the file.
    pub(super) fn read(&self, at: u64, length: u64, out: &mut Vec<u8>) -> Result<(), LogError> {
        out.clear();
        out.resize(length.min(self.length.saturating_sub(at)) as usize, 0);
        let mut done = 0;
        while done < out.len() {
            let byte = at + done as u64;
            match self.file.read_at(&mut out[done..], byte) {
                Ok(0) => break,
                Ok(read) => done += read,
                Err(cause) if cause.kind() == io::ErrorKind::Interrupted => {}
                Err(cause) => return Err(LogError::Read { path: self.path.clone(), byte, cause }),
            }
        }
        out.truncate(done);
        Ok(())
    }
}

/// Reader of consecutive fields; `None` where the bytes end first.
#[derive(Clone, Copy)]
pub(super) struct FieldReader<'a>(&'a [u8]);

impl<'a> FieldReader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    /// Unread rest.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.0
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(head)
    }

    /// Takes at most `length` bytes.
    pub(super) fn take_up_to(&mut self, length: usize) -> &'a [u8] {
        let (head, rest) = self.0.split_at(length.min(self.0.len()));
        self.0 = rest;
        head
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*head)
    }

    pub(super) fn u8(&mut self) -> Option<u8> {
        self.array::<1>().map(|[byte]| byte)
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// Takes a text after its length.
    pub(super) fn text(&mut self) -> Option<&'a str> {
        let length = self.u32()? as usize;
        std::str::from_utf8(self.take(length)?).ok()
    }

    /// Takes a record: its opcode and its content.
    pub(super) fn record(&mut self) -> Option<(u8, &'a [u8])> {
        let opcode = self.u8()?;
        let length = usize::try_from(self.u64()?).ok()?;
        Some((opcode, self.take(length)?))
    }
}
