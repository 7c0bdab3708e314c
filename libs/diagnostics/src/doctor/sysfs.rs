//! Reading what the kernel tells in files, below a root folder that need not be `/`.

use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// The folder that stands for `/`.
#[derive(Clone, Debug)]
pub struct SysfsRoot(PathBuf);

impl SysfsRoot {
    /// A folder; `/` for this machine.
    #[must_use]
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self(folder.into())
    }

    fn path(&self, path: &str) -> PathBuf {
        self.0.join(path.trim_start_matches('/'))
    }

    /// A file's text without the white space around it; `None` if it cannot be read.
    pub(super) fn text(&self, path: &str) -> Option<String> {
        let bytes = fs::read(self.path(path)).ok()?;
        Some(String::from_utf8_lossy(&bytes).trim().to_owned())
    }

    /// A file's only number; `None` also if it holds something else.
    pub(super) fn number<T: FromStr>(&self, path: &str) -> Option<T> {
        self.text(path)?.parse().ok()
    }

    /// Whether something is there.
    pub(super) fn exists(&self, path: &str) -> bool {
        self.path(path).exists()
    }

    /// Numbers of a folder's entries that are called `prefix` and a number, ascending.
    pub(super) fn numbered(&self, folder: &str, prefix: &str) -> Vec<usize> {
        let Ok(entries) = fs::read_dir(self.path(folder)) else { return Vec::new() };
        let number = |name: String| name.strip_prefix(prefix).and_then(|rest| rest.parse().ok());
        let mut all: Vec<usize> =
            entries.flatten().filter_map(|entry| number(entry.file_name().to_string_lossy().into_owned())).collect();
        all.sort_unstable();
        all
    }
}

impl Default for SysfsRoot {
    fn default() -> Self {
        Self::new(Path::new("/"))
    }
}

/// Largest number of a core that is taken for one.
const MOST_CORES: usize = 65_536;

/// The kernel's lists of cores, as `0-2,5`; what is no such list is empty.
pub(super) fn core_list(text: &str) -> Vec<usize> {
    let mut cores = Vec::new();
    for part in text.split(',').map(str::trim).filter(|part| !part.is_empty()) {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        match (first.parse::<usize>(), last.parse::<usize>()) {
            (Ok(first), Ok(last)) if first <= last && last < MOST_CORES => cores.extend(first..=last),
            _ => return Vec::new(),
        }
    }
    cores
}

/// A list of cores as the kernel writes it.
pub(super) fn ranges(cores: &[usize]) -> String {
    let mut parts: Vec<(usize, usize)> = Vec::new();
    for &core in cores {
        match parts.last_mut() {
            Some((_, last)) if *last + 1 == core => *last = core,
            _ => parts.push((core, core)),
        }
    }
    let one = |(first, last): (usize, usize)| if first == last { first.to_string() } else { format!("{first}-{last}") };
    parts.into_iter().map(one).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_cores_are_read_and_written_as_the_kernel_does() {
        for text in ["", "0", "0-3", "0-2,5", "1,3,5-7"] {
            assert_eq!(ranges(&core_list(text)), text);
        }
        for nonsense in ["x", "3-1", "0-", "0-99999999", "-1"] {
            assert_eq!(core_list(nonsense), Vec::<usize>::new(), "{nonsense}");
        }
    }

    #[test]
    fn numbered_entries_are_in_the_order_of_their_numbers() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["cpu10", "cpu2", "cpufreq", "cpu"] {
            fs::create_dir(folder.path().join(name)).unwrap();
        }
        let root = SysfsRoot::new(folder.path());
        assert_eq!(root.numbered("/", "cpu"), [2, 10]);
        assert_eq!(root.numbered("/nowhere", "cpu"), Vec::<usize>::new());
    }
}
