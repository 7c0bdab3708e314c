//! Checks of the machine before anything starts: a run that cannot last is rejected with the number that it needs.

use crate::recorder::free_bytes;
use anyhow::{Result, ensure};
use hapfic_config::{PERIOD_S, Settings};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;

/// Folder of POSIX shared memory.
const SHM: &str = "/dev/shm";
/// Shared memory of a run, with room for a restart [bytes]: the segments of all processes have 66 MB, all reserved.
const SHM_BYTES: u64 = 72 << 20;
/// Open files of a supervisor with all processes connected, and room for restarts.
const OPEN_FILES: u64 = 512;
/// Size of a log per simulated second [bytes]: twice that of the scenario `floor`.
const LOG_BYTES_PER_S: f64 = 1.5e6;

/// Checks shared memory, open files and the size limit of files.
///
/// # Errors
/// The first that does not suffice: what was found, and what the run needs.
pub fn check(settings: &Settings, log: &Path) -> Result<()> {
    // A file system without a limit reports no blocks.
    if let Some(fs) = rustix::fs::statvfs(SHM).ok().filter(|fs| fs.f_blocks > 0) {
        let free = fs.f_bavail * fs.f_frsize;
        ensure!(
            free >= SHM_BYTES,
            "{SHM}: found {:.1} MB free, expected at least {} MB for the segments of a run. Hint: remove files from it, or \
             `docker run --shm-size 256m`",
            free as f64 / 1e6,
            SHM_BYTES >> 20
        );
    }
    raise_open_files();
    let files = getrlimit(Resource::Nofile).current.unwrap_or(u64::MAX);
    ensure!(
        files >= OPEN_FILES,
        "RLIMIT_NOFILE: found {files} open files, expected at least {OPEN_FILES}. Hint: `ulimit -n {OPEN_FILES}`"
    );
    let bytes = getrlimit(Resource::Fsize).current.unwrap_or(u64::MAX);
    let whole = settings.duration_ticks as f64 * PERIOD_S * LOG_BYTES_PER_S + LOG_BYTES_PER_S;
    let needed = settings.recorder.part_mb.map_or(whole, |part| whole.min(2e6 * f64::from(part)));
    // A pipe or a device has no size.
    let is_file = std::fs::metadata(log).map_or(true, |metadata| metadata.is_file());
    ensure!(
        !is_file || bytes as f64 >= needed,
        "RLIMIT_FSIZE: found {:.1} MB, expected at least {:.1} MB for the log of {:.1} s. Hint: `ulimit -f unlimited`",
        bytes as f64 / 1e6,
        needed / 1e6,
        settings.duration_ticks as f64 * PERIOD_S
    );
    let least = u64::from(settings.recorder.min_free_mb) * 1_000_000;
    // The folder may still be missing: it will be on the disk of the one above it.
    let free =
        log.ancestors().skip(1).find_map(|above| free_bytes(if above.as_os_str().is_empty() { Path::new(".") } else { above }));
    ensure!(
        !is_file || free.is_none_or(|free| free >= least),
        "{}: found {} MB free on its disk, expected at least recorder.min_free_mb = {}",
        log.display(),
        free.unwrap_or(0) / 1_000_000,
        least / 1_000_000
    );
    Ok(())
}

/// Raises the soft limit of open files, as far as that is allowed.
fn raise_open_files() {
    let limit = getrlimit(Resource::Nofile);
    let raised = limit.maximum.map_or(OPEN_FILES, |maximum| maximum.min(OPEN_FILES));
    if limit.current.is_some_and(|current| current < raised) {
        // A failure shows in the check.
        let _ = setrlimit(Resource::Nofile, Rlimit { current: Some(raised), ..limit });
    }
}

/// Reserves the memory of all segments of a run, which an access could otherwise find missing.
///
/// # Errors
/// If the file system has not enough space.
pub fn reserve_segments(prefix: &str) -> Result<()> {
    for entry in std::fs::read_dir(SHM)?.flatten() {
        if !entry.file_name().to_string_lossy().starts_with(prefix) {
            continue;
        }
        // A segment may vanish, or be read-only: then its maker has reserved it, or no process writes to it.
        let no_link = rustix::fs::OFlags::NOFOLLOW.bits() as i32;
        let opened = std::fs::File::options().read(true).write(true).custom_flags(no_link).open(entry.path());
        let Ok(file) = opened else { continue };
        let Ok(metadata) = file.metadata() else { continue };
        // Other users may put files of any name beside the run's.
        let own = metadata.is_file() && metadata.uid() == rustix::process::geteuid().as_raw();
        if own && metadata.len() > 0 {
            let reserved = rustix::fs::fallocate(&file, rustix::fs::FallocateFlags::KEEP_SIZE, 0, metadata.len());
            ensure!(
                reserved != Err(rustix::io::Errno::NOSPC),
                "{SHM}: cannot reserve {} bytes for a segment of the run, expected {} MB free. Hint: remove files from it",
                metadata.len(),
                SHM_BYTES >> 20
            );
        }
    }
    Ok(())
}
