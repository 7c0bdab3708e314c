//! Checks of the kernel: version, preemption model, throttling of real-time threads, clock source.

use super::check::{Level, MachineCheck, Subject};
use super::sysfs::SysfsRoot;

/// Oldest kernel that a run supports: it has `pidfd_open`.
const OLDEST: (u32, u32) = (5, 3);

/// Checks the kernel's version.
pub(super) fn version(root: &SysfsRoot) -> MachineCheck {
    const WANTED: &str = "Linux 5.3 or newer";
    let Some(release) = root.text("/proc/sys/kernel/osrelease") else { return MachineCheck::unknown(Subject::Kernel, WANTED) };
    let mut numbers = release.split(|c: char| !c.is_ascii_digit()).map(|part| part.parse::<u32>().ok());
    match (numbers.next().flatten(), numbers.next().flatten()) {
        (Some(major), Some(minor)) => {
            let level = if (major, minor) >= OLDEST { Level::Good } else { Level::Bad };
            MachineCheck::at(level, Subject::Kernel, format!("Linux {release}"), WANTED, "install a newer kernel")
        }
        _ => {
            MachineCheck::at(Level::Unknown, Subject::Kernel, format!("an unknown version: {release}"), WANTED, "run `uname -r`")
        }
    }
}

/// Checks the preemption model of the kernel.
pub(super) fn preemption(root: &SysfsRoot) -> MachineCheck {
    const WANTED: &str = "PREEMPT_RT, else full preemption";
    const REALTIME: &str =
        "install a PREEMPT_RT kernel: `apt install linux-image-rt-amd64` (Debian), `pro enable realtime-kernel` (Ubuntu)";
    const FULL: &str = "boot with `preempt=full`, or now, as root: `echo full > /sys/kernel/debug/sched/preempt`";
    let check = |level, found: &str, how: &str| MachineCheck::at(level, Subject::Preemption, found, WANTED, how);
    let built = root.text("/proc/sys/kernel/version");
    let has = |word: &str| built.as_deref().is_some_and(|text| text.split_whitespace().any(|part| part == word));
    if root.number::<u32>("/sys/kernel/realtime") == Some(1) || has("PREEMPT_RT") {
        return check(Level::Good, "PREEMPT_RT", "");
    }
    // `none voluntary (full) lazy`, readable only for root; else the boot parameter.
    let present = root.text("/sys/kernel/debug/sched/preempt").and_then(|text| {
        let chosen = text.split_once('(')?.1.split_once(')')?.0;
        Some(chosen.to_owned())
    });
    let at_boot = || {
        let line = root.text("/proc/cmdline")?;
        let chosen = line.split_whitespace().filter_map(|word| word.strip_prefix("preempt=")).next_back()?;
        Some(chosen.to_owned())
    };
    match present.or_else(at_boot).as_deref() {
        Some("full") => return check(Level::Good, "full", ""),
        Some("lazy") => return check(Level::Fair, "lazy", FULL),
        Some(other @ ("voluntary" | "none")) => return check(Level::Bad, other, FULL),
        _ => {}
    }
    match &built {
        None => MachineCheck::unknown(Subject::Preemption, WANTED),
        Some(_) if has("PREEMPT_DYNAMIC") => {
            let how = format!("{FULL}; that file shows the model once debugfs is mounted");
            MachineCheck { level: Level::Unknown, ..check(Level::Fair, "chosen at boot (PREEMPT_DYNAMIC), unknown which", &how) }
        }
        Some(_) if has("PREEMPT") => check(Level::Good, "full (PREEMPT)", ""),
        Some(_) => check(Level::Bad, "voluntary or none", REALTIME),
    }
}

/// Checks the share of each period that real-time threads may use.
pub(super) fn throttling(root: &SysfsRoot) -> MachineCheck {
    const WANTED: &str = "at least 90 % of each period, or no limit";
    const HOW: &str = "as root: `sysctl kernel.sched_rt_runtime_us=950000`";
    let runtime: Option<i64> = root.number("/proc/sys/kernel/sched_rt_runtime_us");
    let period: Option<i64> = root.number("/proc/sys/kernel/sched_rt_period_us").filter(|period| *period > 0);
    let check = |level, found: String| MachineCheck::at(level, Subject::Throttling, found, WANTED, HOW);
    match (runtime, period) {
        (Some(runtime), _) if runtime < 0 => check(Level::Good, "no limit".to_owned()),
        (Some(runtime), Some(period)) => {
            let percent = runtime as f64 / period as f64 * 100.0;
            let level = match percent {
                p if p >= 90.0 => Level::Good,
                p if p >= 50.0 => Level::Fair,
                _ => Level::Bad,
            };
            check(level, format!("real-time threads may use {percent:.0} % of each {:.0} ms", period as f64 / 1e3))
        }
        _ => MachineCheck::unknown(Subject::Throttling, WANTED),
    }
}

/// Checks the clock source of the kernel.
pub(super) fn clock(root: &SysfsRoot) -> MachineCheck {
    const WANTED: &str = "one that the processor reads without a bus access: tsc, kvm-clock, arch_sys_counter";
    const FOLDER: &str = "/sys/devices/system/clocksource/clocksource0";
    let Some(current) = root.text(&format!("{FOLDER}/current_clocksource")) else {
        return MachineCheck::unknown(Subject::Clock, WANTED);
    };
    let level = match current.as_str() {
        "tsc" | "kvm-clock" | "arch_sys_counter" | "hyperv_clocksource_tsc_page" | "riscv_clocksource" | "timebase" => {
            Level::Good
        }
        "hpet" | "acpi_pm" | "jiffies" | "refined-jiffies" | "pit" => Level::Bad,
        _ => Level::Fair,
    };
    let available = root.text(&format!("{FOLDER}/available_clocksource")).unwrap_or_default();
    let how = match available.split_whitespace().find(|name| ["tsc", "kvm-clock", "arch_sys_counter"].contains(name)) {
        Some(better) => format!("as root: `echo {better} > {FOLDER}/current_clocksource`"),
        None => "boot with `clocksource=tsc tsc=reliable`; `dmesg | grep -i tsc` shows why the kernel rejected it".to_owned(),
    };
    MachineCheck::at(level, Subject::Clock, current, WANTED, how)
}
