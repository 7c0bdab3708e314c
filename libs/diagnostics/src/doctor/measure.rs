//! The measurement: a timer as the plant has it, and wake-ups as the chain has them, in the same milliseconds.

use super::lateness::Tally;
use super::sysfs::SysfsRoot;
use super::wakeup::{Line, Turn, ask_all};
use anyhow::{Context, Result, anyhow};
use hapfic_ipc::clock;
use hapfic_ipc::realtime::{
    CpuLatencyGuard, Prefault, SchedGrants, SchedRequest, apply_to_current_thread, lock_memory, page_faults,
};
use hapfic_log::metrics::Quantiles;
use hapfic_messages::PERIOD_NS;
use serde::Serialize;
use std::thread::{Builder, ScopedJoinHandle};

/// Ticks before anything counts: pages come in, cores wake up.
const WARM_UP: u64 = 100;
/// When in a period threads are woken, ns: out of the way of the timer, and long after each other.
const SAME_CORE_NS: u64 = 400_000;
const OTHER_CORE_NS: u64 = 700_000;

/// What was measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measurement {
    /// How long, s.
    pub seconds: f64,
    /// The core of the timer; none: any.
    pub core: Option<usize>,
    /// Priority that was asked for.
    pub priority: u32,
    /// Whether it was granted: else the ordinary scheduler, as for everybody.
    pub fifo: bool,
    /// Whether memory was locked.
    pub locked: bool,
    /// Whether deep idle states were held off.
    pub idle_held: bool,
    /// Ticks of the timer.
    pub ticks: u64,
    /// How late they were, us.
    pub lateness_us: Quantiles,
    /// Ticks more than 100 us late.
    pub over_100_us: u64,
    /// Ticks more than 500 us late.
    pub over_500_us: u64,
    /// Ticks more than 1 ms late.
    pub over_1_ms: u64,
    /// Periods that a run would have lost.
    pub late_ticks: u64,
    /// Times three periods or more were lost at once: a drive that gets no command for so long brakes by itself.
    pub brakes: u64,
    /// Time the host kept the timer's core for others meanwhile, ms, in steps of 10; none where the kernel does not text.
    pub steal_ms: Option<u64>,
    /// Page faults of the timer's thread.
    pub page_faults: u64,
    /// Interrupts that devices made on the timer's core meanwhile; none where the kernel does not text.
    pub interrupts: Option<u64>,
    /// From waking a thread on the same core until it runs, us.
    pub wake_same_core_us: Option<Quantiles>,
    /// From waking a thread on another core until it runs, us; none where there is no other.
    pub wake_other_core_us: Option<Quantiles>,
}

/// Measures for so many seconds, with the permissions there are.
///
/// # Errors
/// If threads cannot be started, or one of those does not run.
pub fn measure(seconds: u32, priority: u32, core: Option<usize>, other: Option<usize>) -> Result<Measurement> {
    lock_memory(Prefault::All);
    let idle = CpuLatencyGuard::take();
    let root = SysfsRoot::default();
    let counted = || (core.and_then(|core| steal_ms(&root, core)), core.and_then(|core| interrupts(&root, core)));
    let below = |less: u32| priority.saturating_sub(less).max(1) as i32;
    let sched = |less, core| SchedRequest { priority: below(less), core };
    let (near, far) = (Line::default(), Line::default());
    let (near, far) = (&near, &far);
    let start = clock::now_ns() + 10 * PERIOD_NS;
    let from = start + WARM_UP * PERIOD_NS;
    let to = from + u64::from(seconds) * 1_000_000_000;
    std::thread::scope(|scope| {
        let spawn = |name: &str| Builder::new().name(name.to_owned());
        let started = || -> Result<_> {
            spawn("doctor-near").spawn_scoped(scope, move || near.answer(sched(2, core)))?;
            let mut turns = vec![Turn { line: near, phase_ns: SAME_CORE_NS }];
            if let Some(other) = other {
                spawn("doctor-far").spawn_scoped(scope, move || far.answer(sched(2, Some(other))))?;
                turns.push(Turn { line: far, phase_ns: OTHER_CORE_NS });
            }
            let pings = spawn("doctor-wakeup").spawn_scoped(scope, move || {
                let _ = apply_to_current_thread(sched(1, core));
                let _ = ask_all(&turns, start, from)?;
                ask_all(&turns, from, to)
            })?;
            let timer = spawn("doctor-timer").spawn_scoped(scope, move || timer(sched(0, core), start, from, to))?;
            Ok((pings, timer))
        };
        let done = started().context("cannot start a thread").and_then(|(pings, timer)| {
            clock::sleep_until(from);
            let before = counted();
            let timed = join(timer);
            let after = counted();
            Ok((join(pings)?, timed?, before, after))
        });
        near.close();
        far.close();
        let (pings, (granted, tally, page_faults), before, after) = done?;
        let mut pings = pings.iter().map(hapfic_log::metrics::Latencies::quantiles_us);
        let between = |a: Option<u64>, b: Option<u64>| Some(b?.saturating_sub(a?));
        Ok(Measurement {
            seconds: f64::from(seconds),
            core: core.filter(|_| granted.has(SchedGrants::PINNED)),
            priority,
            fifo: granted.has(SchedGrants::FIFO),
            locked: granted.has(SchedGrants::LOCKED),
            idle_held: idle.is_some(),
            ticks: tally.ticks,
            lateness_us: tally.lateness.quantiles_us().context("no tick was measured")?,
            over_100_us: tally.over_100_us,
            over_500_us: tally.over_500_us,
            over_1_ms: tally.over_1_ms,
            late_ticks: tally.late_ticks,
            brakes: tally.brakes,
            steal_ms: between(before.0, after.0),
            page_faults,
            interrupts: between(before.1, after.1),
            wake_same_core_us: pings.next().flatten(),
            wake_other_core_us: pings.next().flatten(),
        })
    })
}

fn join<T>(thread: ScopedJoinHandle<'_, Result<T>>) -> Result<T> {
    thread.join().map_err(|_| anyhow!("a thread of the measurement panicked"))?
}

/// Waits for an absolute timer as the plant does, and counts how late it comes.
fn timer(sched: SchedRequest, start: u64, from: u64, to: u64) -> Result<(SchedGrants, Tally, u64)> {
    let mut tally = Tally::default();
    let mut warming = Tally::default();
    let granted = apply_to_current_thread(sched);
    let mut faults = page_faults();
    let mut due = start;
    while due < to {
        let mut wake = clock::now_ns();
        while wake < due {
            clock::sleep_until(due);
            wake = clock::now_ns();
        }
        let counts = if due < from { &mut warming } else { &mut tally };
        let slipped = counts.record(wake - due);
        if due < from {
            faults = page_faults();
        }
        due += PERIOD_NS * (1 + slipped);
    }
    Ok((granted, tally, page_faults().saturating_sub(faults)))
}

/// Time stolen from one core since boot, ms.
fn steal_ms(root: &SysfsRoot, core: usize) -> Option<u64> {
    let text = root.text("/proc/stat")?;
    let name = format!("cpu{core}");
    let mut words = text.lines().map(str::split_whitespace).find_map(|mut words| (words.next()? == name).then_some(words))?;
    // USER_HZ is 100 on every Linux there is.
    Some(words.nth(7)?.parse::<u64>().ok()? * 10)
}

/// Interrupts of devices on one core since boot: the numbered rows of the table, in the core's column.
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
    use super::*;

    #[test]
    fn a_second_has_its_ticks() {
        let process_info = super::super::ProcessInfo::ask(2, 0);
        let other = process_info.cores.iter().copied().find(|other| Some(*other) != process_info.core);
        let m = measure(1, 2, process_info.core, other).unwrap();
        // Each period was a tick, or lost to a late one; the last may be lost beyond the end.
        assert!(m.ticks + m.late_ticks >= 1000 && m.ticks <= 1000, "{m:?}");
        assert!(m.over_100_us >= m.over_500_us && m.over_500_us >= m.over_1_ms && m.late_ticks >= m.brakes, "{m:?}");
        assert!(m.wake_same_core_us.is_some());
        assert_eq!(m.wake_other_core_us.is_some(), other.is_some());
    }

    #[test]
    fn one_core_is_told_from_another() {
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
