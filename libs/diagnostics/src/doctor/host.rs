//! Checks of competitors for the processors: host, other programs, quota.

use super::check::{Level, MachineCheck, Subject};
use super::process_info::ProcessInfo;
use super::sysfs::SysfsRoot;
use std::path::{Component, Path};

/// Checks whether this is a virtual machine.
pub(super) fn hypervisor(root: &SysfsRoot) -> MachineCheck {
    const WANTED: &str = "none: a host may suspend a virtual processor at any time";
    const HOW: &str = "a physical machine, or dedicated virtual processors pinned to cores (`virsh vcpupin`)";
    let kind = root.text("/sys/hypervisor/type").filter(|kind| !kind.is_empty());
    // Only on x86 processors.
    let flagged = root.text("/proc/cpuinfo").and_then(|text| {
        let flags = text.lines().find(|line| line.starts_with("flags"))?;
        Some(flags.split_whitespace().any(|flag| flag == "hypervisor"))
    });
    let vendor = root.text("/sys/class/dmi/id/sys_vendor").filter(|vendor| !vendor.is_empty());
    match (kind, flagged) {
        (Some(kind), _) => MachineCheck::at(Level::Fair, Subject::Hypervisor, kind, WANTED, HOW),
        (None, Some(true)) => {
            let found = vendor.map_or("a virtual machine".to_owned(), |vendor| format!("a virtual machine ({vendor})"));
            MachineCheck::at(Level::Fair, Subject::Hypervisor, found, WANTED, HOW)
        }
        (None, Some(false)) => MachineCheck::good(Subject::Hypervisor, "none", WANTED),
        (None, None) => MachineCheck::unknown(Subject::Hypervisor, WANTED),
    }
}

/// Checks the steal time since boot.
pub(super) fn steal(root: &SysfsRoot) -> MachineCheck {
    const WANTED: &str = "below 0.1 % of the time";
    let share = root.text("/proc/stat").and_then(|text| steal_share(&text));
    let Some(share) = share else { return MachineCheck::unknown(Subject::Steal, WANTED) };
    let percent = share * 100.0;
    let level = match percent {
        p if p < 0.1 => Level::Good,
        p if p < 1.0 => Level::Fair,
        _ => Level::Bad,
    };
    let how = "use dedicated virtual processors, or a physical machine";
    MachineCheck::at(level, Subject::Steal, format!("{percent:.2} % since boot"), WANTED, how)
}

/// Steal time as a share of all processors' time since boot, from the first line of `/proc/stat`.
fn steal_share(stat: &str) -> Option<f64> {
    let mut words = stat.lines().next()?.split_whitespace();
    if words.next() != Some("cpu") {
        return None;
    }
    // user nice system idle iowait irq softirq steal; user already includes the guest times after them.
    let times: Vec<u64> = words.take(8).map_while(|word| word.parse().ok()).collect();
    let total = times.iter().fold(0_u64, |sum, time| sum.saturating_add(*time));
    (times.len() == 8 && total > 0).then(|| times[7] as f64 / total as f64)
}

/// Checks the load of the machine.
pub(super) fn load(root: &SysfsRoot, process_info: &ProcessInfo) -> MachineCheck {
    const WANTED: &str = "below half of the cores";
    let load: Option<f64> =
        root.text("/proc/loadavg").and_then(|text| text.split_whitespace().next().and_then(|word| word.parse().ok()));
    let Some(load) = load.filter(|load| load.is_finite()) else { return MachineCheck::unknown(Subject::Load, WANTED) };
    let cores = process_info.cores.len().max(1) as f64;
    let level = match load / cores {
        part if part < 0.5 => Level::Good,
        part if part < 1.5 => Level::Fair,
        _ => Level::Bad,
    };
    let how = "end other programs: `top` shows them";
    MachineCheck::at(level, Subject::Load, format!("{load:.2} on {cores} cores in the last minute"), WANTED, how)
}

/// Checks the processor time that this process's control group may use.
pub(super) fn quota(root: &SysfsRoot) -> MachineCheck {
    const WANTED: &str = "no limit: it stops the recorder and all other threads that are not real-time";
    const HOW: &str =
        "start the container without `--cpus`/`--cpu-quota`, the unit without `CPUQuota=`; use `--cpuset-cpus` instead";
    let Some(groups) = root.text("/proc/self/cgroup") else { return MachineCheck::unknown(Subject::Quota, WANTED) };
    if !root.exists("/sys/fs/cgroup") {
        return MachineCheck::unknown(Subject::Quota, WANTED);
    }
    match groups.lines().filter_map(|line| group_quota(root, line)).min_by(f64::total_cmp) {
        None => MachineCheck::good(Subject::Quota, "no limit", WANTED),
        Some(cores) => {
            let level = if cores < 2.0 { Level::Bad } else { Level::Fair };
            MachineCheck::at(level, Subject::Quota, format!("{cores:.2} cores"), WANTED, HOW)
        }
    }
}

/// Smallest quota from a control group up to the root [cores].
///
/// `line` is one of `/proc/self/cgroup`: `0::/path` or `4:cpu,cpuacct:/path`.
fn group_quota(root: &SysfsRoot, line: &str) -> Option<f64> {
    let mut parts = line.splitn(3, ':');
    let (id, controllers, path) = (parts.next()?, parts.next()?, parts.next()?);
    let second = id == "0" && controllers.is_empty();
    let mounts: Vec<String> = if second {
        vec!["/sys/fs/cgroup".to_owned(), "/sys/fs/cgroup/unified".to_owned()]
    } else if controllers.split(',').any(|name| name == "cpu") {
        vec![format!("/sys/fs/cgroup/{controllers}"), "/sys/fs/cgroup/cpu".to_owned()]
    } else {
        return None;
    };
    // Within a container the path may be the host's view; only existing folders count.
    let steps: Vec<_> = Path::new(path)
        .components()
        .filter_map(|step| if let Component::Normal(name) = step { name.to_str() } else { None })
        .collect();
    let folders = (0..=steps.len()).map(|depth| steps[..depth].join("/"));
    let all = folders.flat_map(|folder| mounts.iter().map(move |mount| format!("{mount}/{folder}")));
    all.filter_map(|folder| if second { second_version(root, &folder) } else { first_version(root, &folder) })
        .min_by(f64::total_cmp)
}

/// Quota of version 2 [cores], from `cpu.max`: `max 100000` or `150000 100000`.
fn second_version(root: &SysfsRoot, folder: &str) -> Option<f64> {
    let text = root.text(&format!("{folder}/cpu.max"))?;
    let (quota, period) = text.split_once(' ')?;
    share(quota.parse().ok()?, period.parse().ok()?)
}

/// Quota of version 1 [cores].
fn first_version(root: &SysfsRoot, folder: &str) -> Option<f64> {
    share(root.number(&format!("{folder}/cpu.cfs_quota_us"))?, root.number(&format!("{folder}/cpu.cfs_period_us"))?)
}

fn share(quota: f64, period: f64) -> Option<f64> {
    (quota > 0.0 && period > 0.0).then(|| quota / period)
}
