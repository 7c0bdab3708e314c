//! Remains of a run on the machine, as the operating system shows them.

use std::fs;

/// Files in shared memory and processes of the run of a launcher with this process id.
#[must_use]
pub fn remains_of(launcher: u32) -> Vec<String> {
    let prefix = format!("hf{}", base36(launcher));
    let mut found: Vec<String> = fs::read_dir("/dev/shm")
        .expect("shared memory")
        .flatten()
        .map(|e| e.file_name().to_string_lossy().into_owned())
        // A run's name is its process id and up to four more digits.
        .filter(|name| name.strip_prefix(&prefix).is_some_and(|rest| rest.find('_').unwrap_or(rest.len()) <= 4))
        .map(|name| format!("/dev/shm/{name}"))
        .collect();
    let mark = format!("HAPFIC_RUN=/dev/shm/{prefix}");
    for pid in processes() {
        let environment = fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
        if environment.split(|b| *b == 0).any(|v| v.starts_with(mark.as_bytes())) {
            found.push(format!("process {pid}"));
        }
    }
    found
}

/// Processes of the run of a launcher: name (`supervisor`, `plant`, `planner`, ...) and process id. They are children of the
/// supervisor, or of the launcher if a lost supervisor has started them.
#[must_use]
pub fn children_of(launcher: u32) -> Vec<(String, u32)> {
    let own = named_children(launcher);
    let supervised = own.iter().filter(|(name, _)| name == "supervisor").flat_map(|(_, pid)| named_children(*pid));
    supervised.chain(own.iter().cloned()).collect()
}

fn named_children(parent: u32) -> Vec<(String, u32)> {
    processes()
        .filter(|pid| parent_of(*pid) == Some(parent))
        .filter_map(|pid| {
            let line = fs::read(format!("/proc/{pid}/cmdline")).ok()?;
            let words: Vec<_> = line.split(|b| *b == 0).map(String::from_utf8_lossy).collect();
            let at = words.iter().position(|w| w == "process")?;
            Some((words.get(at + 1)?.to_string(), pid))
        })
        .collect()
}

/// Whether a process runs; a zombie does not.
#[must_use]
pub fn is_running(pid: u32) -> bool {
    fs::read_to_string(format!("/proc/{pid}/stat"))
        .is_ok_and(|s| s.rsplit(')').next().is_some_and(|rest| !rest.trim_start().starts_with(['Z', 'X'])))
}

fn parent_of(pid: u32) -> Option<u32> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    stat.rsplit(')').next()?.split_whitespace().nth(1)?.parse().ok()
}

fn processes() -> impl Iterator<Item = u32> {
    fs::read_dir("/proc").expect("/proc").flatten().filter_map(|e| e.file_name().to_str()?.parse().ok())
}

fn base36(value: u32) -> String {
    let (mut value, mut digits) = (value, Vec::new());
    while value > 0 || digits.is_empty() {
        digits.push(char::from_digit(value % 36, 36).expect("a digit"));
        value /= 36;
    }
    digits.iter().rev().collect()
}
