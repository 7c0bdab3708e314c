//! The file of a log: created and locked, or a pipe that has a reader.

use super::BUFFER;
use crate::error::LogError;
use std::fs::{File, TryLockError};
use std::io::{self, BufWriter, Seek};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Output, and a second handle of a regular file.
pub(super) type OpenFile<W> = (W, Option<File>);

/// The created and locked file of a log, or an open pipe or device.
#[derive(Debug)]
pub struct LogFile {
    pub(super) path: PathBuf,
    pub(super) file: File,
    /// Whether it is a regular file.
    pub(super) regular: bool,
}

impl LogFile {
    /// Creates or empties a file, and locks it; opens a pipe that has a reader. `in_parts` removes the later parts of an
    /// earlier log of this name.
    ///
    /// # Errors
    /// [`LogError::Create`] and [`LogError::Busy`].
    pub fn create(path: impl AsRef<Path>, in_parts: bool) -> Result<Self, LogError> {
        let path = path.as_ref();
        // Before anything is touched: all that the new log may replace has to be a log.
        let stale = if in_parts { crate::parts::replaceable(path)? } else { Vec::new() };
        let (file, regular) = create_file(path)?;
        for stale in stale {
            std::fs::remove_file(&stale).map_err(|cause| LogError::Create { path: stale, cause })?;
        }
        Ok(Self { path: path.to_owned(), file, regular })
    }

    /// A file that another process has created, by a handle of it. A regular file is emptied.
    ///
    /// # Errors
    /// [`LogError::Create`] if the handle cannot be examined, or the file not be emptied.
    pub fn of_handle(path: &Path, file: File) -> Result<Self, LogError> {
        let mut log = Self::shared(path, file)?;
        log.empty()?;
        Ok(log)
    }

    /// Empties a regular file.
    pub(crate) fn empty(&mut self) -> Result<(), LogError> {
        match self.regular {
            true => self
                .file
                .set_len(0)
                .and_then(|()| self.file.rewind())
                .map_err(|cause| LogError::Create { path: self.path.clone(), cause }),
            false => Ok(()),
        }
    }

    /// A file that another process has created and may have written, by a handle of it.
    ///
    /// # Errors
    /// [`LogError::Create`] if the handle cannot be examined.
    pub fn shared(path: &Path, file: File) -> Result<Self, LogError> {
        let regular = file.metadata().map_err(|cause| LogError::Create { path: path.to_owned(), cause })?.is_file();
        Ok(Self { path: path.to_owned(), file, regular })
    }

    /// Another handle of the file, which shares lock and position.
    ///
    /// # Errors
    /// [`LogError::Create`] if the process has too many open files.
    pub fn handle(&self) -> Result<File, LogError> {
        self.file.try_clone().map_err(|cause| LogError::Create { path: self.path.clone(), cause })
    }

    /// Whether the log is a regular file: it alone has parts.
    #[must_use]
    pub fn is_regular(&self) -> bool {
        self.regular
    }
}

/// Creates or empties the file of a later part, and locks it.
pub(super) fn create_part(path: &Path) -> Result<OpenFile<BufWriter<File>>, LogError> {
    let (file, regular) = create_file(path)?;
    let disk = match regular {
        true => Some(file.try_clone().map_err(|cause| LogError::Create { path: path.to_owned(), cause })?),
        false => None,
    };
    Ok((BufWriter::with_capacity(BUFFER, file), disk))
}

/// Creates or empties a file, and locks it; returns whether it is a regular one.
fn create_file(path: &Path) -> Result<(File, bool), LogError> {
    let failed = |cause| LogError::Create { path: path.to_owned(), cause };
    // Truncated only with the lock: another run may be writing the file.
    let file = open_for_writing(path).map_err(failed)?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => return Err(LogError::Busy { path: path.to_owned() }),
        Err(TryLockError::Error(cause)) => return Err(failed(cause)),
    }
    let regular = file.metadata().map_err(failed)?.is_file();
    if regular {
        file.set_len(0).map_err(failed)?;
    }
    Ok((file, regular))
}

/// Time that a pipe may stay without a reader.
const READER_TIMEOUT: Duration = Duration::from_secs(5);
/// Interval at which a reader is looked for.
const READER_POLL_INTERVAL: Duration = Duration::from_millis(10);

/// Opens a file, or a pipe that has a reader; never blocks for longer than [`READER_TIMEOUT`].
fn open_for_writing(path: &Path) -> io::Result<File> {
    let is_pipe = std::fs::metadata(path).is_ok_and(|metadata| metadata.file_type().is_fifo());
    if !is_pipe {
        return File::options().write(true).create(true).truncate(false).open(path);
    }
    let begun = Instant::now();
    loop {
        // Without a reader this open fails, where another would block.
        match File::options().write(true).custom_flags(O_NONBLOCK).open(path) {
            Ok(_nonblocking) => return File::options().write(true).open(path),
            Err(e) if e.raw_os_error() == Some(ENXIO) && begun.elapsed() < READER_TIMEOUT => {
                std::thread::sleep(READER_POLL_INTERVAL);
            }
            Err(e) if e.raw_os_error() == Some(ENXIO) => {
                return Err(io::Error::other("it is a pipe, and no program has opened it for reading within 5 s"));
            }
            Err(e) => return Err(e),
        }
    }
}

/// `O_NONBLOCK` and `ENXIO` of Linux.
const O_NONBLOCK: i32 = 0o4000;
const ENXIO: i32 = 6;
