//! What a run takes of the machine, seen from outside.

use hapfic_tests::{children_of, remains_of};
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Bytes of a block, as the system counts them.
const BLOCK: u64 = 512;

/// What a process takes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Taken {
    /// Resident memory, kB.
    pub(crate) rss_kb: u64,
    pub(crate) threads: u64,
    pub(crate) files: u64,
}

/// What a run takes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sample {
    /// When, s after the start of the program.
    pub(crate) at_s: f64,
    pub(crate) supervisor: Taken,
    pub(crate) plant: Taken,
    /// Files in shared memory.
    pub(crate) shared: u64,
    /// What they take of it, bytes.
    pub(crate) shared_bytes: u64,
    /// Entries of the run's folder in shared memory, and of those in it.
    pub(crate) entries: u64,
}

impl Sample {
    /// Takes a sample of a run that is under way; `None` if it is not, or not any more.
    pub(crate) fn take(supervisor: u32, at_s: f64) -> Option<Self> {
        let plant = children_of(supervisor).into_iter().find(|(name, _)| name == "plant")?.1;
        let mut sample = Self { at_s, supervisor: taken(supervisor)?, plant: taken(plant)?, ..Self::default() };
        for name in remains_of(supervisor) {
            let path = Path::new(&name);
            // Others are processes, or have gone meanwhile.
            let Ok(found) = fs::symlink_metadata(path) else { continue };
            if found.is_dir() {
                sample.entries += entries(path);
            } else {
                sample.shared += 1;
                sample.shared_bytes += found.blocks() * BLOCK;
            }
        }
        Some(sample)
    }
}

fn taken(pid: u32) -> Option<Taken> {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let figure = |name: &str| -> Option<u64> {
        let line = status.lines().find_map(|line| line.strip_prefix(name))?;
        line.split_whitespace().next()?.parse().ok()
    };
    let files = fs::read_dir(format!("/proc/{pid}/fd")).ok()?.count() as u64;
    Some(Taken { rss_kb: figure("VmRSS:")?, threads: figure("Threads:")?, files })
}

fn entries(folder: &Path) -> u64 {
    let Ok(list) = fs::read_dir(folder) else { return 0 };
    list.flatten().map(|entry| 1 + if entry.path().is_dir() { entries(&entry.path()) } else { 0 }).sum()
}

#[cfg(test)]
mod tests {
    use super::{entries, taken};

    #[test]
    fn this_process_takes_something() {
        let own = taken(std::process::id()).unwrap();
        assert!(own.rss_kb > 0 && own.threads > 0 && own.files > 2, "{own:?}");
        assert!(taken(u32::MAX).is_none());
    }

    #[test]
    fn entries_are_counted_through_all_folders() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("a")).unwrap();
        std::fs::write(folder.path().join("a/b"), "").unwrap();
        std::fs::write(folder.path().join("c"), "").unwrap();
        assert_eq!(entries(folder.path()), 3);
    }
}
