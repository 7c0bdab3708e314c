//! Resources of a run, as the operating system shows them.

use hapfic_tests::{children_of, remains_of};
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Size of a block [bytes].
const BLOCK: u64 = 512;

/// Resources of a process.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ProcessResources {
    /// Resident memory [kB].
    pub(crate) rss_kb: u64,
    pub(crate) threads: u64,
    pub(crate) files: u64,
}

/// Resources of a run.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ResourceSample {
    /// Time since the start of the program [s].
    pub(crate) at_s: f64,
    pub(crate) launcher: ProcessResources,
    pub(crate) plant: ProcessResources,
    /// The present supervisor, gates and recorder, which are lost now and then.
    pub(crate) supervisor: ProcessResources,
    pub(crate) gates: [ProcessResources; 2],
    pub(crate) recorder: ProcessResources,
    /// Number of files in shared memory.
    pub(crate) shared: u64,
    /// Size of these files [bytes].
    pub(crate) shared_bytes: u64,
    /// Number of entries in the run's folder in shared memory, at any depth.
    pub(crate) entries: u64,
}

impl ResourceSample {
    /// Takes a sample of a run; `None` before its start or after its end.
    pub(crate) fn take(launcher: u32, at_s: f64) -> Option<Self> {
        let children = children_of(launcher);
        let of = |wanted: &str| resources(children.iter().find(|(name, _)| name == wanted)?.1);
        let mut sample = Self {
            at_s,
            launcher: resources(launcher)?,
            plant: of("plant")?,
            supervisor: of("supervisor")?,
            gates: [of("gate")?, of("spare_gate")?],
            recorder: of("recorder")?,
            ..Self::default()
        };
        for name in remains_of(launcher) {
            let path = Path::new(&name);
            // Other entries are processes, or have vanished meanwhile.
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

fn resources(pid: u32) -> Option<ProcessResources> {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let figure = |name: &str| -> Option<u64> {
        let line = status.lines().find_map(|line| line.strip_prefix(name))?;
        line.split_whitespace().next()?.parse().ok()
    };
    let files = fs::read_dir(format!("/proc/{pid}/fd")).ok()?.count() as u64;
    Some(ProcessResources { rss_kb: figure("VmRSS:")?, threads: figure("Threads:")?, files })
}

fn entries(folder: &Path) -> u64 {
    let Ok(list) = fs::read_dir(folder) else { return 0 };
    list.flatten().map(|entry| 1 + if entry.path().is_dir() { entries(&entry.path()) } else { 0 }).sum()
}

#[cfg(test)]
mod tests {
    use super::{entries, resources};

    #[test]
    fn resources_own_process_measured() {
        let own = resources(std::process::id()).unwrap();
        assert!(own.rss_kb > 0 && own.threads > 0 && own.files > 2, "{own:?}");
        assert!(resources(u32::MAX).is_none());
    }

    #[test]
    fn entries_nested_folders_counted() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("a")).unwrap();
        std::fs::write(folder.path().join("a/b"), "").unwrap();
        std::fs::write(folder.path().join("c"), "").unwrap();
        assert_eq!(entries(folder.path()), 3);
    }
}
