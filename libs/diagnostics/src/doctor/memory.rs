//! Checks of the kernel's memory management: swap and huge pages.

use super::check::{Level, MachineCheck, Subject};
use super::process_info::ProcessInfo;
use super::sysfs::SysfsRoot;

/// Checks whether memory may be swapped out.
pub(super) fn swap(root: &SysfsRoot, process_info: &ProcessInfo) -> MachineCheck {
    const WANTED: &str = "none, or memory locked";
    let Some(text) = root.text("/proc/swaps") else { return MachineCheck::unknown(Subject::Swap, WANTED) };
    match text.lines().skip(1).filter(|line| !line.trim().is_empty()).count() {
        0 => MachineCheck::good(Subject::Swap, "none", WANTED),
        count if process_info.may_lock() => {
            MachineCheck::good(Subject::Swap, format!("{count} in use; memory is locked during a run"), WANTED)
        }
        count => MachineCheck::at(Level::Fair, Subject::Swap, format!("{count} in use"), WANTED, "as root: `swapoff -a`"),
    }
}

/// Checks whether the kernel merges pages to huge pages.
pub(super) fn huge_pages(root: &SysfsRoot) -> MachineCheck {
    const WANTED: &str = "madvise or never: merging pages stops the threads that use them";
    const FILE: &str = "/sys/kernel/mm/transparent_hugepage/enabled";
    let Some(text) = root.text(FILE) else { return MachineCheck::unknown(Subject::HugePages, WANTED) };
    let chosen = text.split_once('[').and_then(|(_, rest)| rest.split_once(']')).map(|(chosen, _)| chosen);
    let level = match chosen {
        Some("madvise" | "never") => Level::Good,
        Some("always") => Level::Fair,
        _ => return MachineCheck::unknown(Subject::HugePages, WANTED),
    };
    MachineCheck::at(level, Subject::HugePages, chosen.unwrap_or_default(), WANTED, format!("as root: `echo madvise > {FILE}`"))
}
