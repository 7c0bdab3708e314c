//! Machine and date of a table.

use std::fs::read_to_string;
use std::time::{SystemTime, UNIX_EPOCH};

const SECONDS_PER_DAY: u64 = 86_400;

/// Note above a table: date, command, machine and steal time.
pub(crate) fn note(command: &str, steal_ms: u64) -> String {
    let info = read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let model = model.map_or("an unknown processor", |(_, name)| name.trim());
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let kernel = read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs());
    let (year, month, day) = hapfic_ipc::clock::date(seconds / SECONDS_PER_DAY);
    format!(
        "Made on {year}-{month:02}-{day:02} by `{command}`: {model}, {cores} processors, Linux {}; {:.1} s steal time over all \
         processors.\n",
        kernel.trim(),
        steal_ms as f64 * 1e-3
    )
}

/// Steal time of all processors since boot [ms]; zero if the system does not report it.
pub(crate) fn steal_ms() -> u64 {
    hapfic_ipc::clock::steal_ms(&read_to_string("/proc/stat").unwrap_or_default(), "cpu").unwrap_or(0)
}
