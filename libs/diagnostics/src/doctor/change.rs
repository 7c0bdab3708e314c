//! What to change, most effective first: only what checks and measurement both speak for.

use super::check::{Level, MachineChecks, Subject};
use super::measure::Measurement;
use serde::Serialize;

/// Most changes that are named.
pub(super) const MOST: usize = 5;
/// Tail of the lateness from which it is worth doing something about, us.
const TAIL_US: f64 = 100.0;
/// Ordinary lateness from which the processor is asleep or slow, us.
const SLUGGISH_US: f64 = 20.0;

/// Something to change.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Change {
    /// What it is about.
    pub subject: Subject,
    /// What speaks for it.
    pub why: String,
    /// How: a command, or a line of a file.
    pub how: String,
}

/// What the measurement has to show for a change to be worth its trouble.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum When {
    /// Nothing: without it a run cannot be relied on, whatever ten seconds show.
    Always,
    /// The host was seen to take the core away, and ticks were late.
    Stolen,
    /// Some ticks were late.
    Tail,
    /// All ticks are somewhat late.
    Sluggish,
    /// Pages were missing in the middle of a tick.
    Faults,
}

impl When {
    fn holds(self, m: &Measurement) -> bool {
        match self {
            Self::Always => true,
            Self::Stolen => m.steal_ms.is_some_and(|ms| ms > 0) && m.over_500_us > 0,
            Self::Tail => m.lateness_us.p999 > TAIL_US || m.over_500_us > 0,
            Self::Sluggish => m.lateness_us.p50 > SLUGGISH_US,
            Self::Faults => m.page_faults > 0,
        }
    }
}

/// The rules, most effective change first: what it takes to run at all, permissions, the clock, the host, the kernel, the processor's
/// sleep and speed, its other users, memory.
///
/// A subject at one of the levels, and one of the moments: the change is named. Unknown checks count only where the measurement
/// can speak for itself.
const RULES: [(Subject, &[Level], &[When]); 20] = {
    use Level::{Bad, Fair, Unknown};
    use When::{Always, Faults, Sluggish, Stolen, Tail};
    [
        (Subject::Kernel, &[Bad], &[Always]),
        (Subject::SharedMemory, &[Bad, Fair], &[Always]),
        (Subject::OpenFiles, &[Bad, Fair], &[Always]),
        (Subject::Priority, &[Bad], &[Always]),
        (Subject::MemoryLock, &[Bad], &[Always]),
        (Subject::Throttling, &[Bad, Fair], &[Always]),
        (Subject::Resolution, &[Bad], &[Always]),
        (Subject::Clock, &[Bad], &[Always]),
        (Subject::Hypervisor, &[Fair], &[Stolen]),
        (Subject::Preemption, &[Bad, Fair, Unknown], &[Tail]),
        (Subject::CpuLatencyGuard, &[Fair], &[Sluggish, Tail]),
        (Subject::IdleStates, &[Bad, Fair], &[Sluggish, Tail]),
        (Subject::Quota, &[Bad], &[Always]),
        (Subject::Governor, &[Bad, Fair], &[Sluggish, Tail]),
        (Subject::Load, &[Bad, Fair], &[Tail]),
        (Subject::Isolation, &[Fair], &[Tail]),
        (Subject::Siblings, &[Fair], &[Tail]),
        (Subject::Cores, &[Fair], &[Tail]),
        (Subject::Swap, &[Fair], &[Faults]),
        (Subject::HugePages, &[Fair], &[Faults, Tail]),
    ]
};

/// What to change, most effective first.
pub(super) fn changes(checks: &MachineChecks, measured: &Measurement) -> Vec<Change> {
    let wanted = RULES.iter().filter_map(|(subject, levels, when)| {
        let check = checks.get(*subject).filter(|check| levels.contains(&check.level))?;
        let seen = when.iter().find(|when| when.holds(measured))?;
        // Where nothing can be done, nothing is asked for.
        let how = check.how.clone()?;
        // One hint at deep sleep is enough: the states are held off by the permission.
        let said = *subject == Subject::IdleStates && checks.level(Subject::CpuLatencyGuard) == Level::Fair;
        (!said).then(|| Change { subject: *subject, why: why(*seen, &check.found, measured), how })
    });
    wanted.take(MOST).collect()
}

fn why(when: When, found: &str, m: &Measurement) -> String {
    let q = &m.lateness_us;
    match when {
        When::Always => found.to_owned(),
        When::Stolen => format!("{found}; {} ms of the core were taken meanwhile", m.steal_ms.unwrap_or(0)),
        When::Tail => format!("{found}; of 1000 ticks one was more than {:.0} us late, the latest {:.0} us", q.p999, q.max),
        When::Sluggish => format!("{found}; every other tick was more than {:.0} us late", q.p50),
        When::Faults => format!("{found}; {} page faults in the midst of ticks", m.page_faults),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::samples::{all_at, good_measurement, late_measurement, with};
    use super::*;

    fn subjects(checks: &MachineChecks, m: &Measurement) -> Vec<Subject> {
        changes(checks, m).into_iter().map(|change| change.subject).collect()
    }

    #[test]
    fn nothing_is_changed_where_all_is_good() {
        assert_eq!(subjects(&all_at(Level::Good), &good_measurement()), []);
        assert_eq!(subjects(&all_at(Level::Good), &late_measurement()), []);
        assert_eq!(subjects(&MachineChecks::default(), &late_measurement()), []);
    }

    /// Each rule by itself, at each level, with each measurement: named where the rules say so, and nowhere else.
    #[test]
    fn each_change_is_named_when_facts_and_measurement_speak_for_it() {
        let good = good_measurement();
        let measurements = [
            good.clone(),
            late_measurement(),
            Measurement { lateness_us: hapfic_log::metrics::Quantiles { p50: 30.0, ..good.lateness_us }, ..good.clone() },
            Measurement { page_faults: 3, ..good.clone() },
            Measurement { steal_ms: Some(40), ..late_measurement() },
        ];
        for (subject, levels, when) in RULES {
            for level in [Level::Good, Level::Fair, Level::Bad, Level::Unknown] {
                for m in &measurements {
                    let checks = with(&all_at(Level::Good), subject, level);
                    let expected = levels.contains(&level) && when.iter().any(|when| when.holds(m));
                    assert_eq!(
                        subjects(&checks, m),
                        if expected { vec![subject] } else { vec![] },
                        "{subject:?} {level:?} {m:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn no_more_than_five_are_named_and_the_earlier_rules_first() {
        let m = Measurement { steal_ms: Some(40), page_faults: 1, ..late_measurement() };
        let bad = subjects(&all_at(Level::Bad), &m);
        assert_eq!(bad, [Subject::Kernel, Subject::SharedMemory, Subject::OpenFiles, Subject::Priority, Subject::MemoryLock]);
        // Any two: in the order of the rules.
        for (place, (a, a_levels, _)) in RULES.into_iter().enumerate() {
            for (b, b_levels, _) in RULES.into_iter().skip(place + 1) {
                let checks = with(&with(&all_at(Level::Good), a, a_levels[0]), b, b_levels[0]);
                // One hint at deep sleep is enough.
                let expected = if (a, b) == (Subject::CpuLatencyGuard, Subject::IdleStates) { vec![a] } else { vec![a, b] };
                assert_eq!(subjects(&checks, &m), expected);
            }
        }
        // Permissions before preemption, before idle states.
        let place = |subject| RULES.iter().position(|rule| rule.0 == subject).unwrap();
        let order = [Subject::Priority, Subject::MemoryLock, Subject::Preemption, Subject::CpuLatencyGuard, Subject::Governor];
        assert!(order.windows(2).all(|pair| place(pair[0]) < place(pair[1])));
    }

    #[test]
    fn no_change_is_named_that_nobody_knows_how_to_make() {
        let mut checks = with(&all_at(Level::Good), Subject::Preemption, Level::Bad);
        for check in &mut checks.0 {
            check.how = None;
        }
        assert_eq!(subjects(&checks, &late_measurement()), []);
    }
}
