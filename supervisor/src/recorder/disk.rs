//! Free space of the disk that holds the log.

use hapfic_log::LogError;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Interval between two looks at the disk: at 2 MB/s the least of 64 MB is far away for a second.
const INTERVAL: Duration = Duration::from_secs(1);

/// Watch of the free space.
pub(super) struct Disk {
    log: PathBuf,
    folder: PathBuf,
    /// Free space at which the log ends [bytes]; zero: none.
    least: u64,
    looked: Option<Instant>,
}

impl Disk {
    pub(super) fn new(log: &Path, least: u64) -> Self {
        let folder = log.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned();
        // A pipe or a device takes no space.
        let is_file = std::fs::metadata(log).is_ok_and(|metadata| metadata.is_file());
        Self { log: log.to_owned(), folder, least: if is_file { least } else { 0 }, looked: None }
    }

    /// Looks at the disk once a second; an error says that too little is free.
    pub(super) fn check(&mut self) -> Result<(), LogError> {
        if self.least == 0 || self.looked.is_some_and(|at| at.elapsed() < INTERVAL) {
            return Ok(());
        }
        self.looked = Some(Instant::now());
        match free_bytes(&self.folder) {
            Some(free) if free < self.least => {
                let [free, least] = [free, self.least].map(|bytes| bytes / 1_000_000);
                let what = format!("the disk has {free} MB free, expected at least recorder.min_free_mb = {least}");
                Err(LogError::Write { path: self.log.clone(), cause: io::Error::new(io::ErrorKind::StorageFull, what) })
            }
            _ => Ok(()),
        }
    }
}

/// Free space for this user on the disk of a folder [bytes]; `None` if the disk does not say.
pub(crate) fn free_bytes(folder: &Path) -> Option<u64> {
    let disk = rustix::fs::statvfs(folder).ok()?;
    Some(disk.f_bavail.saturating_mul(disk.f_frsize))
}
