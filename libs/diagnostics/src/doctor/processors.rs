//! The processors: which may be used, who else uses them, how deep they sleep and how fast they run.

use super::check::{Level, MachineCheck, Subject};
use super::process_info::ProcessInfo;
use super::sysfs::{SysfsRoot, core_list, ranges};

const CPUS: &str = "/sys/devices/system/cpu";
/// Exit latencies up to which an idle state costs little, and from which it costs a lot, us.
const QUICK_US: u64 = 20;
const SLOW_US: u64 = 100;

/// The processors this process may use.
pub(super) fn cores(root: &SysfsRoot, process_info: &ProcessInfo) -> MachineCheck {
    const WANTED: &str = "two or more, so that the standby has one of its process_info";
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

/// Whether the run's core is kept free of others.
pub(super) fn isolation(root: &SysfsRoot, process_info: &ProcessInfo) -> MachineCheck {
    const WANTED: &str = "the run's core isolated, without ticks of its process_info (nohz_full)";
    let list = |name: &str| root.text(&format!("{CPUS}/{name}")).map(|text| core_list(&text));
    let (Some(isolated), Some(core)) = (list("isolated"), process_info.core) else {
        return MachineCheck::unknown(Subject::Isolation, WANTED);
    };
    let quiet = list("nohz_full").unwrap_or_default();
    let check = |level, found: String, how: String| MachineCheck::at(level, Subject::Isolation, found, WANTED, how);
    if isolated.contains(&core) {
        let tick = if quiet.contains(&core) { ", without a tick of its process_info" } else { "" };
        return check(Level::Good, format!("{}{tick}; the run's core {core} is one", ranges(&isolated)), String::new());
    }
    if isolated.is_empty() {
        // The first core has the machine's housekeeping, the only one everybody.
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

/// Whether the run's core shares its units with another one.
pub(super) fn siblings(root: &SysfsRoot, process_info: &ProcessInfo) -> MachineCheck {
    const WANTED: &str = "nobody else on the run's physical core";
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
            format!("the run's core {core} shares its units with {}", ranges(&others)),
            WANTED,
            format!("as root: `echo 0 > {CPUS}/cpu{first}/online`, or `echo off > {CPUS}/smt/control`"),
        ),
    }
}

/// How long the run's core takes to leave its deepest sleep.
pub(super) fn idle_states(root: &SysfsRoot, process_info: &ProcessInfo) -> MachineCheck {
    const WANTED: &str = "out of the deepest state in use within 20 us";
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
        return MachineCheck::good(Subject::IdleStates, format!("{found}; held off during a run"), WANTED);
    }
    let level = match latency {
        us if us <= QUICK_US => Level::Good,
        us if us < SLOW_US => Level::Fair,
        _ => Level::Bad,
    };
    let how = format!("`no deep idle` above, or as root: `cpupower idle-set -D {QUICK_US}`");
    MachineCheck::at(level, Subject::IdleStates, found, WANTED, how)
}

/// What sets the run's core's frequency.
pub(super) fn governor(root: &SysfsRoot, process_info: &ProcessInfo) -> MachineCheck {
    const WANTED: &str = "performance";
    let file = format!("{CPUS}/cpu{}/cpufreq/scaling_governor", process_info.core.unwrap_or(0));
    let Some(governor) = root.text(&file) else { return MachineCheck::unknown(Subject::Governor, WANTED) };
    let level = match governor.as_str() {
        WANTED => Level::Good,
        "powersave" => Level::Bad,
        _ => Level::Fair,
    };
    // Drivers that decide in hardware call their usual mode so; it does clock up.
    let active = ["intel_pstate", "amd-pstate-epp"];
    let driver = root.text(&format!("{CPUS}/cpu{}/cpufreq/scaling_driver", process_info.core.unwrap_or(0))).unwrap_or_default();
    let level = if level == Level::Bad && active.contains(&driver.as_str()) { Level::Fair } else { level };
    MachineCheck::at(level, Subject::Governor, governor, WANTED, "as root: `cpupower frequency-set -g performance`")
}

/// Whether the frequency may rise above the nominal one; no reason for anything by itself.
pub(super) fn turbo(root: &SysfsRoot) -> MachineCheck {
    const WANTED: &str = "either; off is steadier, on is faster";
    let no_turbo: Option<u32> = root.number(&format!("{CPUS}/intel_pstate/no_turbo"));
    let boost: Option<u32> = root.number(&format!("{CPUS}/cpufreq/boost"));
    match no_turbo.map(|off| off == 0).or(boost.map(|on| on != 0)) {
        Some(on) => MachineCheck::good(Subject::Turbo, if on { "on" } else { "off" }, WANTED),
        None => MachineCheck::unknown(Subject::Turbo, WANTED),
    }
}
