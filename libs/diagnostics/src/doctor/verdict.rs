//! Verdict on a machine for 1 kHz, by rules.

use super::change::{RecommendedChange, changes};
use super::check::{Level, MachineChecks, Subject};
use super::measure::Measurement;
use serde::Serialize;

/// Maximum of late ticks a minute for a real robot.
const MAX_LATE_PER_MINUTE: f64 = 60.0;
/// Maximum of the 99th percentile of the lateness [us]: half a period.
const MAX_P99_US: f64 = 500.0;
/// Maximum lateness, and its 99.9th percentile, up to which there is a margin [us].
const MARGIN_US: f64 = 500.0;
const MARGIN_P999_US: f64 = 200.0;
/// Number of consecutive wake-ups from state to command: controller, gate, plant.
const WAKE_UPS: f64 = 3.0;
/// Deadline from state to command [us]: the setting `supervisor.deadline_us`. Half of it leaves a margin.
const DEADLINE_US: f64 = 800.0;

/// Grade of a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// 1 kHz with margin.
    Good,
    /// 1 kHz, with some late ticks or little margin.
    Usable,
    /// Not for a real robot; simulation works, unless a run cannot start at all.
    NotGood,
}

/// Verdict on a machine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// Grade of the machine.
    pub grade: Grade,
    /// Verdict in one line.
    pub line: String,
    /// Reasons against a better grade.
    pub reasons: Vec<String>,
    /// Measured late ticks a minute.
    pub late_ticks_per_minute: f64,
    /// Upper bound of late ticks a minute with 95 % certainty, if none was measured.
    pub late_ticks_per_minute_below: Option<f64>,
    /// Recommended changes, most effective first; five at most.
    pub changes: Vec<RecommendedChange>,
}

/// Evaluates checks and measurement.
///
/// - Not good: a run cannot start, there is no real-time priority, the timer is too coarse, a drive would have braked
///   by itself (three periods lost in a row), more than 60 late ticks a minute, p99 of the lateness above half a
///   period, or three wake-ups take longer than the deadline.
/// - Usable: any late tick, maximum lateness above 500 us or p99.9 above 200 us, memory not locked, or three wake-ups
///   take more than half the deadline.
/// - Good: none of these.
#[must_use]
pub fn evaluate(checks: &MachineChecks, measured: &Measurement) -> Evaluation {
    let minutes = measured.seconds / 60.0;
    let per_minute = if minutes > 0.0 { measured.late_ticks as f64 / minutes } else { 0.0 };
    // Rule of three: an event without occurrence has a rate below 3 / duration, with 95 % certainty.
    let below = (measured.late_ticks == 0 && minutes > 0.0).then(|| 3.0 / minutes);
    let defects = defects(checks, measured, per_minute);
    let shortcomings = shortcomings(measured, per_minute);
    let (grade, reasons) = match (defects.is_empty(), shortcomings.is_empty()) {
        (false, _) => (Grade::NotGood, defects),
        (true, false) => (Grade::Usable, shortcomings),
        (true, true) => (Grade::Good, Vec::new()),
    };
    let none = match below {
        Some(below) => format!("no late tick in {:.0} s (fewer than {below:.1} a minute, with 95 % certainty)", measured.seconds),
        None => String::new(),
    };
    let line = match grade {
        Grade::Good => format!("good: 1 kHz with margin; {none}"),
        Grade::Usable if measured.late_ticks > 0 => format!("usable: expect {per_minute:.0} late ticks a minute"),
        Grade::Usable => format!("usable: {none}, but without margin"),
        Grade::NotGood => format!("not for a real robot: {}", reasons.first().map_or("", String::as_str)),
    };
    Evaluation {
        grade,
        line,
        reasons,
        late_ticks_per_minute: per_minute,
        late_ticks_per_minute_below: below,
        changes: changes(checks, measured),
    }
}

/// Lists the reasons for the grade "not good", worst first.
fn defects(checks: &MachineChecks, m: &Measurement, per_minute: f64) -> Vec<String> {
    let bad = |subject| checks.get(subject).filter(|check| check.level == Level::Bad);
    let mut all = Vec::new();
    for subject in [Subject::Kernel, Subject::SharedMemory, Subject::OpenFiles] {
        if let Some(check) = bad(subject) {
            all.push(format!("a run cannot start ({}: found {}, wanted: {})", subject.name(), check.found, check.wanted));
        }
    }
    if m.brakes > 0 {
        all.push(format!("a drive would have braked {} in {:.0} s (three periods lost in a row)", times(m.brakes), m.seconds));
    }
    if per_minute > MAX_LATE_PER_MINUTE {
        all.push(format!("{per_minute:.0} late ticks a minute, expected {MAX_LATE_PER_MINUTE:.0} at most"));
    }
    if m.lateness_us.p99 > MAX_P99_US {
        all.push(format!("lateness p99 is {:.0} us, expected {MAX_P99_US:.0} at most", m.lateness_us.p99));
    }
    if let Some(chain) = chain_us(m).filter(|chain| *chain > DEADLINE_US) {
        all.push(format!("three wake-ups take {chain:.0} us (p99), expected {DEADLINE_US:.0} at most"));
    }
    if let Some(check) = bad(Subject::Resolution) {
        all.push(format!("its timers have a resolution of {}, expected {}", check.found, check.wanted));
    }
    if !m.fifo {
        all.push("its threads get no real-time priority, so any program may delay them".to_owned());
    }
    all
}

/// Lists the reasons for the grade "usable".
fn shortcomings(m: &Measurement, per_minute: f64) -> Vec<String> {
    let q = &m.lateness_us;
    let mut all = Vec::new();
    if m.late_ticks > 0 {
        all.push(format!("{} late ticks in {:.0} s: {per_minute:.0} a minute", m.late_ticks, m.seconds));
    }
    if q.max > MARGIN_US {
        all.push(format!("the maximum lateness is {:.0} us, expected {MARGIN_US:.0} at most", q.max));
    }
    if q.p999 > MARGIN_P999_US {
        all.push(format!("lateness p99.9 is {:.0} us, expected {MARGIN_P999_US:.0} at most", q.p999));
    }
    if let Some(chain) = chain_us(m).filter(|chain| *chain > DEADLINE_US / 2.0) {
        all.push(format!("three wake-ups take {chain:.0} us (p99), expected {:.0} at most", DEADLINE_US / 2.0));
    }
    if !m.locked {
        all.push("its memory is not locked, so a tick may wait for a page".to_owned());
    }
    all
}

/// Duration of the chain's three wake-ups at their 99th percentile [us].
fn chain_us(m: &Measurement) -> Option<f64> {
    m.wake_same_core_us.map(|q| WAKE_UPS * q.p99)
}

fn times(count: u64) -> String {
    if count == 1 { "once".to_owned() } else { format!("{count} times") }
}

#[cfg(test)]
mod tests {
    use super::super::change::MAX_CHANGES;
    use super::super::samples::{all_at, good_measurement, late_measurement, with};
    use super::*;
    use hapfic_log::metrics::Quantiles;

    /// A measurement for each rule, with its grade on an otherwise good machine.
    fn graded_measurements() -> Vec<(&'static str, Measurement, Grade)> {
        let m = good_measurement();
        let late = |q: Quantiles| Measurement { lateness_us: q, ..m.clone() };
        let wake = |p99| Measurement { wake_same_core_us: Some(Quantiles { p99, ..m.lateness_us }), ..m.clone() };
        let q = m.lateness_us;
        vec![
            ("best", m.clone(), Grade::Good),
            ("at the margin", late(Quantiles { max: 500.0, p999: 200.0, ..q }), Grade::Good),
            ("above the margin", late(Quantiles { max: 500.1, ..q }), Grade::Usable),
            ("a tail", late(Quantiles { p999: 200.1, ..q }), Grade::Usable),
            ("half a period", late(Quantiles { p99: 500.0, ..q }), Grade::Good),
            ("over half a period", late(Quantiles { p99: 500.1, ..q }), Grade::NotGood),
            ("one late tick", Measurement { late_ticks: 1, ..m.clone() }, Grade::Usable),
            ("sixty a minute", Measurement { late_ticks: 10, ..m.clone() }, Grade::Usable),
            ("more than sixty a minute", Measurement { late_ticks: 11, ..m.clone() }, Grade::NotGood),
            ("a brake", Measurement { late_ticks: 3, brakes: 1, ..m.clone() }, Grade::NotGood),
            ("no memory locked", Measurement { locked: false, ..m.clone() }, Grade::Usable),
            ("no priority", Measurement { fifo: false, ..m.clone() }, Grade::NotGood),
            ("quick wake-ups", wake(133.0), Grade::Good),
            ("slow wake-ups", wake(134.0), Grade::Usable),
            ("wake-ups beyond the deadline", wake(267.0), Grade::NotGood),
            ("no wake-ups", Measurement { wake_same_core_us: None, ..m.clone() }, Grade::Good),
        ]
    }

    #[test]
    fn evaluate_each_measurement_has_its_grade() {
        for (name, m, expected) in graded_measurements() {
            let verdict = evaluate(&all_at(Level::Good), &m);
            assert_eq!(verdict.grade, expected, "{name}: {}", verdict.line);
            assert_eq!(verdict.reasons.is_empty(), expected == Grade::Good, "{name}: {:?}", verdict.reasons);
        }
    }

    /// Every check at every level, with every measurement.
    #[test]
    fn evaluate_only_deciding_checks_change_grade() {
        let deciding = [Subject::Kernel, Subject::SharedMemory, Subject::OpenFiles, Subject::Resolution];
        let subjects: Vec<Subject> = all_at(Level::Good).0.iter().map(|check| check.subject).collect();
        for (name, m, alone) in graded_measurements() {
            for &subject in &subjects {
                for level in [Level::Good, Level::Fair, Level::Bad, Level::Unknown] {
                    let verdict = evaluate(&with(&all_at(Level::Good), subject, level), &m);
                    let unfit = deciding.contains(&subject) && level == Level::Bad;
                    assert_eq!(verdict.grade, if unfit { Grade::NotGood } else { alone }, "{name}, {subject:?} {level:?}");
                }
            }
        }
    }

    /// Any two shortcomings together are never better than either.
    #[test]
    fn evaluate_two_shortcomings_have_worse_grade() {
        for (a_name, a, a_grade) in graded_measurements() {
            for (b_name, b, b_grade) in graded_measurements() {
                let q = |x: Quantiles, y: Quantiles| Quantiles {
                    p50: x.p50.max(y.p50),
                    p99: x.p99.max(y.p99),
                    p999: x.p999.max(y.p999),
                    max: x.max.max(y.max),
                };
                let both = Measurement {
                    fifo: a.fifo && b.fifo,
                    locked: a.locked && b.locked,
                    late_ticks: a.late_ticks.max(b.late_ticks),
                    brakes: a.brakes.max(b.brakes),
                    lateness_us: q(a.lateness_us, b.lateness_us),
                    wake_same_core_us: match (a.wake_same_core_us, b.wake_same_core_us) {
                        (Some(x), Some(y)) => Some(q(x, y)),
                        (x, y) => x.or(y),
                    },
                    ..a.clone()
                };
                let grade = evaluate(&all_at(Level::Good), &both).grade;
                assert_eq!(grade, a_grade.max(b_grade), "{a_name} and {b_name}");
            }
        }
    }

    #[test]
    fn evaluate_line_states_expected_late_ticks() {
        let line = |m: &Measurement| evaluate(&all_at(Level::Good), m).line;
        let m = good_measurement();
        assert_eq!(line(&m), "good: 1 kHz with margin; no late tick in 10 s (fewer than 18.0 a minute, with 95 % certainty)");
        assert_eq!(line(&Measurement { late_ticks: 2, ..m.clone() }), "usable: expect 12 late ticks a minute");
        let unlocked = line(&Measurement { locked: false, ..m.clone() });
        assert!(unlocked.starts_with("usable: no late tick in 10 s"), "{unlocked}");
        let long = Measurement { seconds: 600.0, ..m.clone() };
        assert_eq!(evaluate(&all_at(Level::Good), &long).late_ticks_per_minute_below, Some(0.3));
        let braked = line(&Measurement { late_ticks: 5, brakes: 1, ..m });
        assert_eq!(braked, "not for a real robot: a drive would have braked once in 10 s (three periods lost in a row)");
    }

    #[test]
    fn evaluate_run_that_cannot_start_comes_first() {
        let checks = with(&all_at(Level::Good), Subject::SharedMemory, Level::Bad);
        let verdict = evaluate(&checks, &Measurement { fifo: false, ..late_measurement() });
        assert!(verdict.line.contains("shared memory"), "{}", verdict.line);
        assert_eq!(verdict.changes[0].subject, Subject::SharedMemory);
        assert!(verdict.reasons.len() > 1 && verdict.changes.len() <= MAX_CHANGES);
    }

    #[test]
    fn evaluate_unknown_checks_leave_measurement_to_decide() {
        assert_eq!(evaluate(&MachineChecks::default(), &good_measurement()).grade, Grade::Good);
        assert_eq!(evaluate(&all_at(Level::Unknown), &late_measurement()).grade, Grade::NotGood);
    }
}
