//! Processor time and memory of a stack, as the operating system shows them.

use hapfic_tests::{children_of, remains_of};
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::Instant;

/// Groups of processor time, in the order of the table: the processes.
pub(crate) const GROUPS: [&str; 7] = ["plant", "planner", "controller", "standby", "gate", "recorder", "supervisor"];
/// Fields of user and system time in a `stat` file, counted after the program's name.
const TIME_FIELDS: [usize; 2] = [11, 12];
/// Unit of these times [1/s]: USER_HZ is 100 on every Linux.
const USER_HZ: f64 = 100.0;
/// Size of a block [bytes].
const BLOCK: u64 = 512;

/// Processor time of a stack since its start.
#[derive(Clone, Debug)]
pub(crate) struct CpuTime {
    at: Instant,
    /// Time by group [s].
    seconds: BTreeMap<&'static str, f64>,
}

impl CpuTime {
    /// Reads the processor time of a run; `None` if one of its processes does not run.
    pub(crate) fn take(launcher: u32) -> Option<Self> {
        let mut seconds = BTreeMap::new();
        let mut add = |group, time| *seconds.entry(group).or_insert(0.0) += time;
        let children = children_of(launcher);
        for group in &GROUPS {
            let pid = children.iter().find(|(name, _)| name == group)?.1;
            add(*group, times(&fs::read_to_string(format!("/proc/{pid}/stat")).ok()?)?);
        }
        Some(Self { at: Instant::now(), seconds })
    }

    /// Share of a core since an earlier reading, by group [%].
    pub(crate) fn since(&self, earlier: &Self) -> BTreeMap<&'static str, f64> {
        let wall = self.at.duration_since(earlier.at).as_secs_f64();
        self.seconds
            .iter()
            .map(|(group, now)| (*group, 100.0 * (now - earlier.seconds.get(group).unwrap_or(&0.0)) / wall))
            .collect()
    }
}

/// User and system time in a `stat` file [s].
fn times(stat: &str) -> Option<f64> {
    // The program's name is in parentheses, and may have any character.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = TIME_FIELDS.map(|field| fields.get(field)?.parse::<u64>().ok());
    Some((ticks[0]? + ticks[1]?) as f64 / USER_HZ)
}

/// Memory of a stack [MB].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MemoryUse {
    /// Proportional set size of all its processes, shared memory included.
    pub(crate) proportional: f64,
    /// Size of its files in shared memory.
    pub(crate) shared: f64,
}

impl MemoryUse {
    /// Reads the memory of a run.
    pub(crate) fn take(launcher: u32) -> Option<Self> {
        let children = children_of(launcher).into_iter().map(|(_, pid)| pid);
        let pages = children.chain([launcher]).map(proportional_kb).sum::<Option<u64>>()?;
        let shared: u64 = remains_of(launcher).iter().map(|name| bytes(Path::new(name))).sum();
        Some(Self { proportional: pages as f64 / 1e3 * 1.024, shared: shared as f64 / 1e6 })
    }
}

fn proportional_kb(pid: u32) -> Option<u64> {
    let text = fs::read_to_string(format!("/proc/{pid}/smaps_rollup")).ok()?;
    text.lines().find_map(|line| line.strip_prefix("Pss:"))?.split_whitespace().next()?.parse().ok()
}

/// Size of a file, or of all files in a folder [bytes]; zero if the path does not exist.
fn bytes(path: &Path) -> u64 {
    let Ok(found) = fs::symlink_metadata(path) else { return 0 };
    let inside = if found.is_dir() { fs::read_dir(path).ok() } else { None };
    found.blocks() * BLOCK + inside.into_iter().flatten().flatten().map(|entry| bytes(&entry.path())).sum::<u64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_any_program_name_found() {
        let stat = "7 (a) b (c d) S 1 2 3 4 5 6 7 8 9 10 150 25 0 0";
        assert_eq!(times(stat), Some(1.75));
        assert_eq!((times("7 (a) S 1"), times("")), (None, None));
        let own = fs::read_to_string("/proc/self/stat").unwrap();
        assert!(times(&own).unwrap() >= 0.0);
    }

    #[test]
    fn since_two_readings_shares_computed() {
        let begun = Instant::now();
        let reading = |seconds_later, plant, gate| CpuTime {
            at: begun + std::time::Duration::from_secs(seconds_later),
            seconds: BTreeMap::from([("plant", plant), ("gate", gate)]),
        };
        let shares = reading(4, 2.0, 0.5).since(&reading(0, 1.0, 0.5));
        assert_eq!(shares, BTreeMap::from([("plant", 25.0), ("gate", 0.0)]));
    }

    #[test]
    fn memory_own_process_read() {
        let own = std::process::id();
        assert!(proportional_kb(own).unwrap() > 0 && proportional_kb(u32::MAX).is_none());
        assert!(CpuTime::take(own).is_none());
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("a")).unwrap();
        std::fs::write(folder.path().join("a/b"), vec![1; 100_000]).unwrap();
        assert!(bytes(folder.path()) >= 100_000 && bytes(Path::new("/no/such/file")) == 0);
    }
}
