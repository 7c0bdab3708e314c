//! Files of the kernel below a root folder, which need not be `/`.

use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Folder that stands for `/`.
#[derive(Clone, Debug)]
pub struct SysfsRoot(PathBuf);

impl SysfsRoot {
    /// Makes the root from a folder; `/` for this machine.
    #[must_use]
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self(folder.into())
    }

    fn path(&self, path: &str) -> PathBuf {
        self.0.join(path.trim_start_matches('/'))
    }

    /// Reads a file's text without the white space around it; `None` if it cannot be read.
    pub(super) fn text(&self, path: &str) -> Option<String> {
        let bytes = fs::read(self.path(path)).ok()?;
        Some(String::from_utf8_lossy(&bytes).trim().to_owned())
    }

    /// Reads a file's only number; `None` also if it holds something else.
    pub(super) fn number<T: FromStr>(&self, path: &str) -> Option<T> {
        self.text(path)?.parse().ok()
    }

    /// Whether a file or folder exists.
    pub(super) fn exists(&self, path: &str) -> bool {
        self.path(path).exists()
    }

    /// Lists the numbers of a folder's entries that are called `prefix` and a number, ascending.
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

/// Limit of valid core numbers.
const MAX_CORES: usize = 65_536;

/// Parses a list of cores like `0-2,5`; an invalid list is empty.
pub(super) fn core_list(text: &str) -> Vec<usize> {
    let mut cores = Vec::new();
    for part in text.split(',').map(str::trim).filter(|part| !part.is_empty()) {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        match (first.parse::<usize>(), last.parse::<usize>()) {
            (Ok(first), Ok(last)) if first <= last && last < MAX_CORES => cores.extend(first..=last),
            _ => return Vec::new(),
        }
    }
    cores
}

/// Formats a list of cores as the kernel does.
pub(super) fn ranges(cores: &[usize]) -> String {
    let mut parts: Vec<(usize, usize)> = Vec::new();
    for &core in cores {
        match parts.last_mut() {
            Some((_, last)) if *last + 1 == core => *last = core,
            _ => parts.push((core, core)),
        }
    }
    let range = |(first, last): (usize, usize)| if first == last { first.to_string() } else { format!("{first}-{last}") };
    parts.into_iter().map(range).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn core_list_valid_text_round_trips() {
        for text in ["", "0", "0-3", "0-2,5", "1,3,5-7"] {
            assert_eq!(ranges(&core_list(text)), text);
        }
        for invalid in ["x", "3-1", "0-", "0-99999999", "-1"] {
            assert_eq!(core_list(invalid), Vec::<usize>::new(), "{invalid}");
        }
    }

    #[test]
    fn numbered_entries_are_ascending() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["cpu10", "cpu2", "cpufreq", "cpu"] {
            fs::create_dir(folder.path().join(name)).unwrap();
        }
        let root = SysfsRoot::new(folder.path());
        assert_eq!(root.numbered("/", "cpu"), [2, 10]);
        assert_eq!(root.numbered("/nowhere", "cpu"), Vec::<usize>::new());
    }
}
