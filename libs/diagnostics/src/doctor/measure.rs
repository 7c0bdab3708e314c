//! Measurement of a timer like the plant's, interleaved with wake-ups like the chain's.

use super::lateness::LatenessCounts;
use super::sysfs::SysfsRoot;
use super::wakeup::{WakeupPair, WakeupProbe, measure_wakeups};
use anyhow::{Context, Result, anyhow};
use hapfic_ipc::clock;
use hapfic_ipc::realtime::{
    CpuLatencyGuard, Prefault, SchedGrants, SchedRequest, apply_to_current_thread, lock_memory, page_faults,
};
use hapfic_log::metrics::Quantiles;
use hapfic_messages::PERIOD_NS;
use serde::Serialize;
use std::thread::{Builder, ScopedJoinHandle};

/// Number of ticks of the warm-up: page faults occur, cores wake up.
const WARM_UP_TICKS: u64 = 100;
/// Phases of the wake-ups in a period [ns]: far from the timer, and from each other.
const SAME_CORE_PHASE_NS: u64 = 400_000;
const OTHER_CORE_PHASE_NS: u64 = 700_000;

/// Measurement of a machine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measurement {
    /// Duration [s].
    pub seconds: f64,
    /// Core of the timer; `None`: any.
    pub core: Option<usize>,
    /// Requested priority.
    pub priority: u32,
    /// Whether SCHED_FIFO was granted; else the scheduler is SCHED_OTHER.
    pub fifo: bool,
    /// Whether memory was locked.
    pub locked: bool,
    /// Whether deep idle states were disabled.
    pub idle_held: bool,
    /// Number of ticks of the timer.
    pub ticks: u64,
    /// Lateness of the ticks [us].
    pub lateness_us: Quantiles,
    /// Number of ticks more than 100 us late.
    pub over_100_us: u64,
    /// Number of ticks more than 500 us late.
    pub over_500_us: u64,
    /// Number of ticks more than 1 ms late.
    pub over_1_ms: u64,
    /// Number of periods that a run would have lost.
    pub late_ticks: u64,
    /// Number of losses of three or more periods in a row, after which a drive brakes by itself.
    pub brakes: u64,
    /// Steal time of the timer's core meanwhile, in steps of 10 [ms]; `None` if the kernel does not report it.
    pub steal_ms: Option<u64>,
    /// Number of page faults of the timer's thread.
    pub page_faults: u64,
    /// Number of device interrupts on the timer's core meanwhile; `None` if the kernel does not report it.
    pub interrupts: Option<u64>,
    /// Wake-up latency of a thread on the same core [us].
    pub wake_same_core_us: Option<Quantiles>,
    /// Wake-up latency of a thread on another core [us]; `None` if there is no other core.
    pub wake_other_core_us: Option<Quantiles>,
}

/// Measures for `seconds` [s], with the permissions of this process.
///
/// # Errors
/// If a thread cannot be started or does not run, or no tick was measured.
pub fn measure(seconds: u32, priority: u32, core: Option<usize>, other: Option<usize>) -> Result<Measurement> {
    lock_memory(Prefault::All);
    let idle = CpuLatencyGuard::take();
    let root = SysfsRoot::default();
    let counters = || (core.and_then(|core| steal_ms(&root, core)), core.and_then(|core| interrupts(&root, core)));
    let below = |less: u32| priority.saturating_sub(less).max(1) as i32;
    let sched = |less, core| SchedRequest { priority: below(less), core };
    let (same_core, other_core) = (&WakeupPair::default(), &WakeupPair::default());
    let start = clock::now_ns() + 10 * PERIOD_NS;
    let from = start + WARM_UP_TICKS * PERIOD_NS;
    let to = from + u64::from(seconds) * 1_000_000_000;
    std::thread::scope(|scope| {
        let spawn = |name: &str| Builder::new().name(name.to_owned());
        let started = || -> Result<_> {
            spawn("doctor-near").spawn_scoped(scope, move || same_core.respond(sched(2, core)))?;
            let mut probes = vec![WakeupProbe { pair: same_core, phase_ns: SAME_CORE_PHASE_NS }];
            if let Some(other) = other {
                spawn("doctor-far").spawn_scoped(scope, move || other_core.respond(sched(2, Some(other))))?;
                probes.push(WakeupProbe { pair: other_core, phase_ns: OTHER_CORE_PHASE_NS });
            }
            let wakeups = spawn("doctor-wakeup").spawn_scoped(scope, move || {
                let _ = apply_to_current_thread(sched(1, core));
                let _ = measure_wakeups(&probes, start, from)?;
                measure_wakeups(&probes, from, to)
            })?;
            let timer = spawn("doctor-timer").spawn_scoped(scope, move || timer(sched(0, core), start, from, to))?;
            Ok((wakeups, timer))
        };
        let done = started().context("cannot start a thread").and_then(|(wakeups, timer)| {
            clock::sleep_until(from);
            let before = counters();
            let timer = join(timer);
            let after = counters();
            Ok((join(wakeups)?, timer?, before, after))
        });
        same_core.close();
        other_core.close();
        let (wakeups, (granted, counts, page_faults), before, after) = done?;
        let mut wakeups = wakeups.iter().map(hapfic_log::metrics::Latencies::quantiles_us);
        let increase = |a: Option<u64>, b: Option<u64>| Some(b?.saturating_sub(a?));
        Ok(Measurement {
            seconds: f64::from(seconds),
            core: core.filter(|_| granted.has(SchedGrants::PINNED)),
            priority,
            fifo: granted.has(SchedGrants::FIFO),
            locked: granted.has(SchedGrants::LOCKED),
            idle_held: idle.is_some(),
            ticks: counts.ticks,
            lateness_us: counts.lateness.quantiles_us().context("no tick was measured")?,
            over_100_us: counts.over_100_us,
            over_500_us: counts.over_500_us,
            over_1_ms: counts.over_1_ms,
            late_ticks: counts.late_ticks,
            brakes: counts.brakes,
            steal_ms: increase(before.0, after.0),
            page_faults,
            interrupts: increase(before.1, after.1),
            wake_same_core_us: wakeups.next().flatten(),
            wake_other_core_us: wakeups.next().flatten(),
        })
    })
}

fn join<T>(thread: ScopedJoinHandle<'_, Result<T>>) -> Result<T> {
    thread.join().map_err(|_| anyhow!("a thread of the measurement panicked"))?
}

/// Waits for an absolute timer as the plant does, and counts its lateness.
fn timer(sched: SchedRequest, start: u64, from: u64, to: u64) -> Result<(SchedGrants, LatenessCounts, u64)> {
    let mut counts = LatenessCounts::default();
    let mut warm_up = LatenessCounts::default();
    let granted = apply_to_current_thread(sched);
    let mut faults = page_faults();
    let mut due = start;
    while due < to {
        let mut wake = clock::now_ns();
        while wake < due {
            clock::sleep_until(due);
            wake = clock::now_ns();
        }
        let phase = if due < from { &mut warm_up } else { &mut counts };
        let slipped = phase.record(wake - due);
        if due < from {
            faults = page_faults();
        }
        due += PERIOD_NS * (1 + slipped);
    }
    Ok((granted, counts, page_faults().saturating_sub(faults)))
}

/// Steal time of one core since boot [ms].
fn steal_ms(root: &SysfsRoot, core: usize) -> Option<u64> {
    hapfic_ipc::clock::steal_ms(&root.text("/proc/stat")?, &format!("cpu{core}"))
}

/// Number of device interrupts on one core since boot: the numbered rows of the table, in the core's column.
fn interrupts(root: &SysfsRoot, core: usize) -> Option<u64> {
    let text = root.text("/proc/interrupts")?;
    let mut lines = text.lines();
    let name = format!("CPU{core}");
    let column = lines.next()?.split_whitespace().position(|word| word == name)?;
    let numbered = lines.filter_map(|line| {
        let (label, counts) = line.split_once(':')?;
        let _: u32 = label.trim().parse().ok()?;
        counts.split_whitespace().nth(column)?.parse::<u64>().ok()
    });
    Some(numbered.sum())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::lateness::BRAKE_PERIODS;
    use super::*;

    /// Asserts relations between counts, which hold for any lateness.
    #[test]
    fn measure_one_second_has_consistent_counts() {
        let process_info = super::super::ProcessInfo::ask(2, 0);
        let other = process_info.cores.iter().copied().find(|other| Some(*other) != process_info.core);
        let m = match measure(1, 2, process_info.core, other) {
            Ok(m) => m,
            // The machine has stalled for the whole measurement.
            Err(e) => return assert!(e.to_string().contains("no tick") || e.to_string().contains("not run"), "{e:#}"),
        };
        assert!((1..=1000).contains(&m.ticks), "{m:?}");
        assert!(m.ticks >= m.over_100_us && m.over_100_us >= m.over_500_us && m.over_500_us >= m.over_1_ms, "{m:?}");
        assert!(m.late_ticks >= m.over_1_ms && m.late_ticks >= BRAKE_PERIODS * m.brakes, "{m:?}");
        assert!(m.wake_same_core_us.is_some());
        assert_eq!(m.wake_other_core_us.is_some(), other.is_some());
    }

    #[test]
    fn counters_of_cores_are_separate() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("proc")).unwrap();
        let root = SysfsRoot::new(folder.path());
        assert_eq!((steal_ms(&root, 0), interrupts(&root, 0)), (None, None));
        let write = |name: &str, text: &str| std::fs::write(folder.path().join("proc").join(name), text).unwrap();
        write("stat", "cpu  9 9 9 9 9 9 9 99 0 0\ncpu0 1 2 3 4 5 6 7 8 0 0\ncpu1 1 2 3 4 5 6 7 25 0 0\ncpu11 1\nintr 5\n");
        write("interrupts", "     CPU0  CPU1\n  1:  5  7  IO-APIC  i8042\n 24:  1  3  PCI\nLOC:  900  900  Local\nERR: 4\n");
        assert_eq!([0, 1, 2, 11].map(|core| steal_ms(&root, core)), [Some(80), Some(250), None, None]);
        assert_eq!([0, 1, 2].map(|core| interrupts(&root, core)), [Some(6), Some(10), None]);
    }
}
