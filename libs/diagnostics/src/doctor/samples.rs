//! Synthetic machines for tests.

use super::check::{Level, MachineCheck, MachineChecks, Subject};
use super::measure::Measurement;
use super::process_info::ProcessInfo;
use super::sysfs::SysfsRoot;
use super::{Grade, checks, evaluate};
use hapfic_ipc::realtime::Privilege;
use hapfic_log::metrics::Quantiles;
use tempfile::TempDir;

const SUBJECTS: [Subject; 22] = [
    Subject::Kernel,
    Subject::Preemption,
    Subject::Priority,
    Subject::MemoryLock,
    Subject::CpuLatencyGuard,
    Subject::Throttling,
    Subject::Clock,
    Subject::Resolution,
    Subject::Cores,
    Subject::Isolation,
    Subject::Siblings,
    Subject::IdleStates,
    Subject::Governor,
    Subject::Turbo,
    Subject::Hypervisor,
    Subject::Steal,
    Subject::Load,
    Subject::Quota,
    Subject::SharedMemory,
    Subject::OpenFiles,
    Subject::Swap,
    Subject::HugePages,
];

/// Makes every check at one level.
pub(super) fn all_at(level: Level) -> MachineChecks {
    let check = |subject| MachineCheck::at(level, subject, "found", "wanted", "how");
    MachineChecks(SUBJECTS.map(check).to_vec())
}

/// Copies the checks, with one at another level.
pub(super) fn with(checks: &MachineChecks, subject: Subject, level: Level) -> MachineChecks {
    let changed = checks.0.iter().map(|check| match check.subject == subject {
        true => MachineCheck::at(level, subject, "found", "wanted", "how"),
        false => check.clone(),
    });
    MachineChecks(changed.collect())
}

/// Ten seconds on a real-time machine.
pub(super) fn good_measurement() -> Measurement {
    let quantiles = Quantiles { p50: 3.0, p99: 8.0, p999: 15.0, max: 25.0 };
    Measurement {
        seconds: 10.0,
        core: Some(3),
        priority: 80,
        fifo: true,
        locked: true,
        idle_held: true,
        ticks: 10_000,
        lateness_us: quantiles,
        over_100_us: 0,
        over_500_us: 0,
        over_1_ms: 0,
        late_ticks: 0,
        brakes: 0,
        steal_ms: Some(0),
        page_faults: 0,
        interrupts: Some(0),
        wake_same_core_us: Some(quantiles),
        wake_other_core_us: Some(quantiles),
    }
}

/// Ten seconds on a shared machine that reports no steal time.
pub(super) fn late_measurement() -> Measurement {
    Measurement {
        lateness_us: Quantiles { p50: 55.0, p99: 400.0, p999: 4_000.0, max: 9_000.0 },
        ticks: 9_950,
        over_100_us: 300,
        over_500_us: 80,
        over_1_ms: 30,
        late_ticks: 50,
        brakes: 4,
        ..good_measurement()
    }
}

fn tree(files: &[(&str, &str)]) -> (TempDir, SysfsRoot) {
    let folder = tempfile::tempdir().unwrap();
    for (path, text) in files {
        let path = folder.path().join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    let root = SysfsRoot::new(folder.path());
    (folder, root)
}

fn process_info(granted: bool, cores: usize) -> ProcessInfo {
    let privilege = |name| Privilege { name, granted, note: "needs something".to_owned() };
    ProcessInfo {
        cores: (0..cores).collect(),
        core: cores.checked_sub(1),
        privileges: ["SCHED_FIFO", "memory lock", "no deep idle"].map(privilege).to_vec(),
        resolution_ns: 1,
        open_files: Some(4096),
        shared_memory: Some((8 << 30, 7 << 30)),
    }
}

const GOOD: &[(&str, &str)] = &[
    ("proc/sys/kernel/osrelease", "6.12.9-rt5\n"),
    ("proc/sys/kernel/version", "#1 SMP PREEMPT_RT Debian 6.12.9\n"),
    ("proc/sys/kernel/sched_rt_runtime_us", "950000\n"),
    ("proc/sys/kernel/sched_rt_period_us", "1000000\n"),
    ("sys/kernel/realtime", "1\n"),
    ("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc\n"),
    ("sys/devices/system/clocksource/clocksource0/available_clocksource", "tsc hpet acpi_pm\n"),
    ("sys/devices/system/cpu/online", "0-3\n"),
    ("sys/devices/system/cpu/isolated", "3\n"),
    ("sys/devices/system/cpu/nohz_full", "3\n"),
    ("sys/devices/system/cpu/cpu3/topology/thread_siblings_list", "3\n"),
    ("sys/devices/system/cpu/cpu3/cpuidle/state0/latency", "0\n"),
    ("sys/devices/system/cpu/cpu3/cpuidle/state1/latency", "890\n"),
    ("sys/devices/system/cpu/cpu3/cpuidle/state1/name", "C10\n"),
    ("sys/devices/system/cpu/cpu3/cpufreq/scaling_governor", "performance\n"),
    ("sys/devices/system/cpu/intel_pstate/no_turbo", "1\n"),
    ("proc/cpuinfo", "processor\t: 0\nflags\t\t: fpu vme sse2\n"),
    ("proc/stat", "cpu  100 0 100 9000 0 0 0 0 0 0\ncpu0 1 2 3\n"),
    ("proc/loadavg", "0.10 0.20 0.30 1/100 4242\n"),
    ("proc/self/cgroup", "0::/user.slice/me.scope\n"),
    ("sys/fs/cgroup/user.slice/cpu.max", "max 100000\n"),
    ("proc/swaps", "Filename Type Size Used Priority\n"),
    ("sys/kernel/mm/transparent_hugepage/enabled", "always [madvise] never\n"),
];

const BAD: &[(&str, &str)] = &[
    ("proc/sys/kernel/osrelease", "4.19.0-17-amd64\n"),
    ("proc/sys/kernel/version", "#1 SMP Debian 4.19.194\n"),
    ("proc/sys/kernel/sched_rt_runtime_us", "0\n"),
    ("proc/sys/kernel/sched_rt_period_us", "1000000\n"),
    ("sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet\n"),
    ("sys/devices/system/clocksource/clocksource0/available_clocksource", "kvm-clock hpet\n"),
    ("sys/devices/system/cpu/online", "0-1\n"),
    ("sys/devices/system/cpu/isolated", "\n"),
    ("sys/devices/system/cpu/cpu1/topology/thread_siblings_list", "0-1\n"),
    ("sys/devices/system/cpu/cpu1/cpuidle/state0/latency", "2\n"),
    ("sys/devices/system/cpu/cpu1/cpuidle/state1/latency", "133\n"),
    ("sys/devices/system/cpu/cpu1/cpuidle/state1/disable", "0\n"),
    ("sys/devices/system/cpu/cpu1/cpuidle/state2/latency", "5000\n"),
    ("sys/devices/system/cpu/cpu1/cpuidle/state2/disable", "1\n"),
    ("sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", "powersave\n"),
    ("sys/devices/system/cpu/cpufreq/boost", "1\n"),
    ("proc/cpuinfo", "processor\t: 0\nflags\t\t: fpu vme hypervisor\n"),
    ("sys/class/dmi/id/sys_vendor", "QEMU\n"),
    ("proc/stat", "cpu  100 0 100 9000 0 0 0 400 0 0\n"),
    ("proc/loadavg", "7.00 5.00 4.00 3/100 4242\n"),
    ("proc/self/cgroup", "3:cpuset:/\n2:cpu,cpuacct:/../docker/abc\n0::/docker/abc\n"),
    ("sys/fs/cgroup/cpu,cpuacct/docker/cpu.cfs_quota_us", "150000\n"),
    ("sys/fs/cgroup/cpu,cpuacct/docker/cpu.cfs_period_us", "100000\n"),
    ("sys/fs/cgroup/docker/abc/cpu.max", "170000 100000\n"),
    ("proc/swaps", "Filename Type Size Used Priority\n/dev/sda2 partition 8388604 0 -2\n"),
    ("sys/kernel/mm/transparent_hugepage/enabled", "[always] madvise never\n"),
];

fn levels(checks: &MachineChecks) -> Vec<(Subject, Level)> {
    checks.0.iter().map(|check| (check.subject, check.level)).collect()
}

#[test]
fn checks_realtime_machine_are_good() {
    let (_folder, root) = tree(GOOD);
    let found = checks(&root, &process_info(true, 4));
    assert_eq!(levels(&found), SUBJECTS.map(|subject| (subject, Level::Good)));
    assert!(found.0.iter().all(|check| check.how.is_none()));
    assert_eq!(evaluate(&found, &good_measurement()).grade, Grade::Good);
}

#[test]
fn checks_bad_virtual_machine_have_instructions() {
    let (_folder, root) = tree(BAD);
    let found = checks(&root, &process_info(false, 2));
    let good = [Subject::Resolution, Subject::Cores, Subject::Turbo, Subject::SharedMemory, Subject::OpenFiles];
    for check in &found.0 {
        assert_eq!(check.level == Level::Good, good.contains(&check.subject), "{check:?}");
        assert!(check.level == Level::Good || check.how.as_ref().is_some_and(|how| !how.is_empty()), "{check:?}");
    }
    let text = |subject| found.get(subject).map(|check| format!("{} / {}", check.found, check.how.as_deref().unwrap_or("")));
    let contains = |subject, expected: &str| assert!(text(subject).unwrap().contains(expected), "{:?}", text(subject));
    contains(Subject::Quota, "1.50 cores");
    contains(Subject::IdleStates, "133 us");
    contains(Subject::Clock, "echo kvm-clock");
    contains(Subject::Hypervisor, "QEMU");
    contains(Subject::Steal, "4.17 %");
    contains(Subject::Siblings, "cpu0/online");
    contains(Subject::Isolation, "isolcpus=1");
}

#[test]
fn checks_silent_kernel_are_unknown() {
    let (_folder, root) = tree(&[]);
    let silent =
        ProcessInfo { cores: Vec::new(), core: None, privileges: Vec::new(), shared_memory: None, ..process_info(false, 0) };
    for check in checks(&root, &silent).0 {
        let known = [Subject::Resolution, Subject::OpenFiles].contains(&check.subject);
        assert_eq!(check.level, if known { Level::Good } else { Level::Unknown }, "{check:?}");
        assert!(known || check.found == "not reported by this kernel");
    }
}

/// Any content of the files gives all checks, without a panic.
#[test]
fn checks_invalid_files_do_not_panic() {
    for invalid in
        ["", "\0\u{fffd}", "-1", "99999999999999999999999", "a:b:c", "NaN", "0::\n1:cpu", "[", "cpu 1 2", "max", "max max"]
    {
        let files: Vec<(&str, &str)> = GOOD.iter().chain(BAD).map(|(path, _)| (*path, invalid)).collect();
        let (_folder, root) = tree(&files);
        assert_eq!(checks(&root, &process_info(true, 4)).0.len(), SUBJECTS.len());
    }
}

#[test]
fn preemption_kernel_file_precedes_boot_parameter() {
    let level = |files: &[(&str, &str)]| {
        let (_folder, root) = tree(files);
        let found = checks(&root, &process_info(true, 1));
        let check = found.get(Subject::Preemption).unwrap();
        (check.level, check.found.clone())
    };
    let dynamic = ("proc/sys/kernel/version", "#1 SMP PREEMPT_DYNAMIC x");
    let present = |text| ("sys/kernel/debug/sched/preempt", text);
    let boot = ("proc/cmdline", "quiet preempt=none preempt=voluntary");
    let case = |files: &[(&str, &str)], expected: Level, what: &str| {
        let (found, text) = level(files);
        assert!(found == expected && text.contains(what), "{found:?} {text}");
    };
    case(&[dynamic, boot, present("none voluntary (full) lazy")], Level::Good, "full");
    case(&[dynamic, boot, present("none voluntary full (lazy)")], Level::Fair, "lazy");
    case(&[dynamic, boot], Level::Bad, "voluntary");
    case(&[dynamic], Level::Unknown, "unknown which");
    case(&[("proc/sys/kernel/version", "#1 SMP PREEMPT x")], Level::Good, "full");
    case(&[("proc/sys/kernel/version", "#1 SMP x")], Level::Bad, "none");
    case(&[("sys/kernel/realtime", "1")], Level::Good, "PREEMPT_RT");
}
