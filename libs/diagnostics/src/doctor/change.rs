//! Recommended changes, most effective first: only those that both checks and measurement support.

use super::check::{Level, MachineChecks, Subject};
use super::measure::Measurement;
use serde::Serialize;

/// Maximum number of recommended changes.
pub(super) const MAX_CHANGES: usize = 5;
/// 99.9th percentile of the lateness above which a change is worthwhile [us].
const TAIL_US: f64 = 100.0;
/// Median lateness above which the processor sleeps or runs slowly [us].
const MEDIAN_US: f64 = 20.0;

/// Recommended change.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct RecommendedChange {
    /// Subject of the check.
    pub subject: Subject,
    /// Finding that supports the change.
    pub why: String,
    /// Instruction: a command, or a line of a file.
    pub how: String,
}

/// Condition on the measurement for a change to be recommended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ChangeCondition {
    /// No condition: without the change no run is reliable, whatever a short measurement shows.
    Always,
    /// There was steal time, and ticks were late.
    Steal,
    /// Some ticks were late.
    Tail,
    /// All ticks were somewhat late.
    Median,
    /// There were page faults during ticks.
    PageFaults,
}

impl ChangeCondition {
    fn holds(self, m: &Measurement) -> bool {
        match self {
            Self::Always => true,
            Self::Steal => m.steal_ms.is_some_and(|ms| ms > 0) && m.over_500_us > 0,
            Self::Tail => m.lateness_us.p999 > TAIL_US || m.over_500_us > 0,
            Self::Median => m.lateness_us.p50 > MEDIAN_US,
            Self::PageFaults => m.page_faults > 0,
        }
    }
}

/// Rules, most effective change first: requirements of a run, permissions, clock, host, kernel, idle states and
/// frequency of the processor, its other users, memory.
///
/// A rule recommends a change if the subject has one of the levels and one of the conditions holds. Unknown checks
/// count only where the measurement alone supports the change.
const RULES: [(Subject, &[Level], &[ChangeCondition]); 20] = {
    use ChangeCondition::{Always, Median, PageFaults, Steal, Tail};
    use Level::{Bad, Fair, Unknown};
    [
        (Subject::Kernel, &[Bad], &[Always]),
        (Subject::SharedMemory, &[Bad, Fair], &[Always]),
        (Subject::OpenFiles, &[Bad, Fair], &[Always]),
        (Subject::Priority, &[Bad], &[Always]),
        (Subject::MemoryLock, &[Bad], &[Always]),
        (Subject::Throttling, &[Bad, Fair], &[Always]),
        (Subject::Resolution, &[Bad], &[Always]),
        (Subject::Clock, &[Bad], &[Always]),
        (Subject::Hypervisor, &[Fair], &[Steal]),
        (Subject::Preemption, &[Bad, Fair, Unknown], &[Tail]),
        (Subject::CpuLatencyGuard, &[Fair], &[Median, Tail]),
        (Subject::IdleStates, &[Bad, Fair], &[Median, Tail]),
        (Subject::Quota, &[Bad], &[Always]),
        (Subject::Governor, &[Bad, Fair], &[Median, Tail]),
        (Subject::Load, &[Bad, Fair], &[Tail]),
        (Subject::Isolation, &[Fair], &[Tail]),
        (Subject::Siblings, &[Fair], &[Tail]),
        (Subject::Cores, &[Fair], &[Tail]),
        (Subject::Swap, &[Fair], &[PageFaults]),
        (Subject::HugePages, &[Fair], &[PageFaults, Tail]),
    ]
};

/// Lists the recommended changes, most effective first.
pub(super) fn changes(checks: &MachineChecks, measured: &Measurement) -> Vec<RecommendedChange> {
    let recommended = RULES.iter().filter_map(|(subject, levels, conditions)| {
        let check = checks.get(*subject).filter(|check| levels.contains(&check.level))?;
        let condition = conditions.iter().find(|condition| condition.holds(measured))?;
        let how = check.how.clone()?;
        // One change for deep idle states is enough: the permission disables them.
        let redundant = *subject == Subject::IdleStates && checks.level(Subject::CpuLatencyGuard) == Level::Fair;
        (!redundant).then(|| RecommendedChange { subject: *subject, why: why(*condition, &check.found, measured), how })
    });
    recommended.take(MAX_CHANGES).collect()
}

fn why(condition: ChangeCondition, found: &str, m: &Measurement) -> String {
    let q = &m.lateness_us;
    match condition {
        ChangeCondition::Always => found.to_owned(),
        ChangeCondition::Steal => format!("{found}; {} ms steal time meanwhile", m.steal_ms.unwrap_or(0)),
        ChangeCondition::Tail => format!("{found}; lateness p99.9 {:.0} us, max {:.0} us", q.p999, q.max),
        ChangeCondition::Median => format!("{found}; lateness p50 {:.0} us", q.p50),
        ChangeCondition::PageFaults => format!("{found}; {} page faults during ticks", m.page_faults),
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
    fn changes_good_checks_are_empty() {
        assert_eq!(subjects(&all_at(Level::Good), &good_measurement()), []);
        assert_eq!(subjects(&all_at(Level::Good), &late_measurement()), []);
        assert_eq!(subjects(&MachineChecks::default(), &late_measurement()), []);
    }

    /// Each rule alone, at each level, with each measurement.
    #[test]
    fn changes_single_check_follows_rules() {
        let good = good_measurement();
        let measurements = [
            good.clone(),
            late_measurement(),
            Measurement { lateness_us: hapfic_log::metrics::Quantiles { p50: 30.0, ..good.lateness_us }, ..good.clone() },
            Measurement { page_faults: 3, ..good.clone() },
            Measurement { steal_ms: Some(40), ..late_measurement() },
        ];
        for (subject, levels, conditions) in RULES {
            for level in [Level::Good, Level::Fair, Level::Bad, Level::Unknown] {
                for m in &measurements {
                    let checks = with(&all_at(Level::Good), subject, level);
                    let expected = levels.contains(&level) && conditions.iter().any(|condition| condition.holds(m));
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
    fn changes_many_checks_are_limited_and_ordered() {
        let m = Measurement { steal_ms: Some(40), page_faults: 1, ..late_measurement() };
        let bad = subjects(&all_at(Level::Bad), &m);
        assert_eq!(bad, [Subject::Kernel, Subject::SharedMemory, Subject::OpenFiles, Subject::Priority, Subject::MemoryLock]);
        // Any two changes keep the order of the rules.
        for (index, (a, a_levels, _)) in RULES.into_iter().enumerate() {
            for (b, b_levels, _) in RULES.into_iter().skip(index + 1) {
                let checks = with(&with(&all_at(Level::Good), a, a_levels[0]), b, b_levels[0]);
                // The second change would be redundant.
                let expected = if (a, b) == (Subject::CpuLatencyGuard, Subject::IdleStates) { vec![a] } else { vec![a, b] };
                assert_eq!(subjects(&checks, &m), expected);
            }
        }
        // Permissions come before preemption, and that before idle states.
        let index = |subject| RULES.iter().position(|rule| rule.0 == subject).unwrap();
        let order = [Subject::Priority, Subject::MemoryLock, Subject::Preemption, Subject::CpuLatencyGuard, Subject::Governor];
        assert!(order.windows(2).all(|pair| index(pair[0]) < index(pair[1])));
    }

    #[test]
    fn changes_check_without_instruction_is_skipped() {
        let mut checks = with(&all_at(Level::Good), Subject::Preemption, Level::Bad);
        for check in &mut checks.0 {
            check.how = None;
        }
        assert_eq!(subjects(&checks, &late_measurement()), []);
    }
}
