//! The file of a log: created and locked, or a pipe that has a reader.

use crate::error::LogError;
use std::fs::{File, TryLockError};
use std::io::{self, BufWriter};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;
use std::time::{Duration, Instant};

/// Output, and a second handle of a regular file.
pub(super) type OpenFile<W> = (W, Option<File>);

/// Creates or empties a file, and locks it.
pub(super) fn create_file(path: &Path) -> Result<OpenFile<BufWriter<File>>, LogError> {
    let failed = |cause| LogError::Create { path: path.to_owned(), cause };
    // Truncated only with the lock: another run may be writing the file.
    let file = open_for_writing(path).map_err(failed)?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => return Err(LogError::Busy { path: path.to_owned() }),
        Err(TryLockError::Error(cause)) => return Err(failed(cause)),
    }
    let mut disk = None;
    if file.metadata().map_err(failed)?.is_file() {
        file.set_len(0).map_err(failed)?;
        disk = Some(file.try_clone().map_err(failed)?);
    }
    Ok((BufWriter::with_capacity(64 * 1024, file), disk))
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
