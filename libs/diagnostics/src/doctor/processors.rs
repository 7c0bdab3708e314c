//! Checks of the processors: usable cores, their other users, idle states and frequency.

use super::check::{Level, MachineCheck, Subject};
use super::process_info::ProcessInfo;
use super::sysfs::{SysfsRoot, core_list, ranges};

const CPUS: &str = "/sys/devices/system/cpu";
/// Exit latencies up to which an idle state costs little, and from which it costs much [us].
const QUICK_US: u64 = 20;
const SLOW_US: u64 = 100;

/// Checks the cores that this process may use.
pub(super) fn cores(root: &SysfsRoot, process_info: &ProcessInfo) -> MachineCheck {
    const WANTED: &str = "two or more, so that the standby has a core of its own";
    let online = root.text(&format!("{CPUS}/online")).map(|text| core_list(&text).len()).filter(|count| *count > 0);
    let of = online.map_or(String::new(), |count| format!(" of {count}"));
    let run = process_info.core.map_or("any".to_owned(), |core| core.to_string());
    match process_info.cores.len() {
        0 => MachineCheck::unknown(Subject::Cores, WANTED),
        1 => MachineCheck::at(
            Level::Fair,
            Subject::Cores,
            format!("core {}{of} alone", ranges(&process_info.cores)),
            WANTED,
            "give this process or its container more: `taskset -c 0-3 hapfic …`, `docker run --cpuset-cpus=0-3`",
        ),
        count => MachineCheck::good(
            Subject::Cores,
            format!("{count}{of} usable: {}; a run would be on {run}", ranges(&process_info.cores)),
            WANTED,
        ),
    }
}

/// Checks whether the run's core is isolated from other processes.
pub(super) fn isolation(root: &SysfsRoot, process_info: &ProcessInfo) -> MachineCheck {
    const WANTED: &str = "the run's core isolated, without ticks of its own (nohz_full)";
    let list = |name: &str| root.text(&format!("{CPUS}/{name}")).map(|text| core_list(&text));
    let (Some(isolated), Some(core)) = (list("isolated"), process_info.core) else {
        return MachineCheck::unknown(Subject::Isolation, WANTED);
    };
    let quiet = list("nohz_full").unwrap_or_default();
    let check = |level, found: String, how: String| MachineCheck::at(level, Subject::Isolation, found, WANTED, how);
    if isolated.contains(&core) {
        let tick = if quiet.contains(&core) { ", without ticks of its own" } else { "" };
        return check(Level::Good, format!("{}{tick}; the run's core {core} is one", ranges(&isolated)), String::new());
    }
    if isolated.is_empty() {
        // The first core does the machine's housekeeping; a single core runs all processes.
        let how = match process_info.cores.iter().any(|&other| other < core) {
            true => format!(
                "boot with `isolcpus={core} nohz_full={core} rcu_nocbs={core}` and run under `taskset -c {}`",
                ranges(&process_info.cores)
            ),
            false => "needs a second core".to_owned(),
        };
        return check(Level::Fair, "none".to_owned(), how);
    }
    let mut both: Vec<usize> = process_info.cores.iter().chain(&isolated).copied().collect();
    both.sort_unstable();
    both.dedup();
    let how = format!("run under `taskset -c {}`: the run takes the last of them", ranges(&both));
    check(Level::Fair, format!("{}; the run's core {core} is none", ranges(&isolated)), how)
}

/// Checks whether the run's core shares its execution units with another one.
pub(super) fn siblings(root: &SysfsRoot, process_info: &ProcessInfo) -> MachineCheck {
    const WANTED: &str = "no other process on the run's physical core";
    let Some(core) = process_info.core else { return MachineCheck::unknown(Subject::Siblings, WANTED) };
    let Some(text) = root.text(&format!("{CPUS}/cpu{core}/topology/thread_siblings_list")) else {
        return MachineCheck::unknown(Subject::Siblings, WANTED);
    };
    let others: Vec<usize> = core_list(&text).into_iter().filter(|other| *other != core).collect();
    match others.first() {
        None => MachineCheck::good(Subject::Siblings, "none", WANTED),
        Some(first) => MachineCheck::at(
            Level::Fair,
            Subject::Siblings,
            format!("the run's core {core} shares its execution units with {}", ranges(&others)),
            WANTED,
            format!("as root: `echo 0 > {CPUS}/cpu{first}/online`, or `echo off > {CPUS}/smt/control`"),
        ),
    }
}

/// Checks the exit latency of the deepest idle state of the run's core.
pub(super) fn idle_states(root: &SysfsRoot, process_info: &ProcessInfo) -> MachineCheck {
    const WANTED: &str = "at most 20 us to leave the deepest state in use";
    let folder = format!("{CPUS}/cpu{}/cpuidle", process_info.core.unwrap_or(0));
    let worst = root
        .numbered(&folder, "state")
        .into_iter()
        .filter(|state| root.number::<u64>(&format!("{folder}/state{state}/disable")).unwrap_or(0) == 0)
        .filter_map(|state| Some((root.number::<u64>(&format!("{folder}/state{state}/latency"))?, state)))
        .max();
    let Some((latency, state)) = worst else { return MachineCheck::unknown(Subject::IdleStates, WANTED) };
    let name = root.text(&format!("{folder}/state{state}/name")).unwrap_or_else(|| format!("state {state}"));
    let found = format!("{latency} us to leave {name}, the deepest");
    if process_info.may_hold_idle() {
        return MachineCheck::good(Subject::IdleStates, format!("{found}; disabled during a run"), WANTED);
    }
    let level = match latency {
        us if us <= QUICK_US => Level::Good,
        us if us < SLOW_US => Level::Fair,
        _ => Level::Bad,
    };
    let how = format!("`no deep idle` above, or as root: `cpupower idle-set -D {QUICK_US}`");
    MachineCheck::at(level, Subject::IdleStates, found, WANTED, how)
}

/// Checks the frequency governor of the run's core.
pub(super) fn governor(root: &SysfsRoot, process_info: &ProcessInfo) -> MachineCheck {
    const WANTED: &str = "performance";
    let file = format!("{CPUS}/cpu{}/cpufreq/scaling_governor", process_info.core.unwrap_or(0));
    let Some(governor) = root.text(&file) else { return MachineCheck::unknown(Subject::Governor, WANTED) };
    let level = match governor.as_str() {
        WANTED => Level::Good,
        "powersave" => Level::Bad,
        _ => Level::Fair,
    };
    // In drivers with hardware control `powersave` is the usual mode, and does raise the frequency.
    let active = ["intel_pstate", "amd-pstate-epp"];
    let driver = root.text(&format!("{CPUS}/cpu{}/cpufreq/scaling_driver", process_info.core.unwrap_or(0))).unwrap_or_default();
    let level = if level == Level::Bad && active.contains(&driver.as_str()) { Level::Fair } else { level };
    MachineCheck::at(level, Subject::Governor, governor, WANTED, "as root: `cpupower frequency-set -g performance`")
}

/// Reports whether the frequency may rise above the nominal one; never a shortcoming.
pub(super) fn turbo(root: &SysfsRoot) -> MachineCheck {
    const WANTED: &str = "either; off is steadier, on is faster";
    let no_turbo: Option<u32> = root.number(&format!("{CPUS}/intel_pstate/no_turbo"));
    let boost: Option<u32> = root.number(&format!("{CPUS}/cpufreq/boost"));
    match no_turbo.map(|off| off == 0).or(boost.map(|on| on != 0)) {
        Some(on) => MachineCheck::good(Subject::Turbo, if on { "on" } else { "off" }, WANTED),
        None => MachineCheck::unknown(Subject::Turbo, WANTED),
    }
}
