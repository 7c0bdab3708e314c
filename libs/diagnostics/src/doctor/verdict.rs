//! One verdict, by rules: whether a machine is good enough for 1 kHz.

use super::change::{Change, changes};
use super::check::{Level, MachineChecks, Subject};
use super::measure::Measurement;
use serde::Serialize;

/// Late ticks a minute above which a run is no use to a robot.
const MOST_LATE_PER_MINUTE: f64 = 60.0;
/// Lateness that every hundredth tick may have, us: half a period.
const P99_AT_MOST_US: f64 = 500.0;
/// Lateness up to which there is a margin, us: of the longest, and of every thousandth tick.
const MARGIN_US: f64 = 500.0;
const MARGIN_P999_US: f64 = 200.0;
/// Threads that are woken one after the other from state to command: controller, gate, plant.
const WAKE_UPS: f64 = 3.0;
/// From state to command at most, us; the setting `supervisor.deadline_us`. Half of it leaves a margin.
const DEADLINE_US: f64 = 800.0;

/// How good a machine is.
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

/// The judgement.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// How good the machine is.
    pub grade: Grade,
    /// The same in one line.
    pub line: String,
    /// All that keeps it from being better.
    pub reasons: Vec<String>,
    /// Late ticks a minute, as measured.
    pub late_ticks_per_minute: f64,
    /// Where none was measured: fewer than so many a minute, with 95 % certainty.
    pub late_ticks_per_minute_below: Option<f64>,
    /// What to change, most effective first; five at most.
    pub changes: Vec<Change>,
}

/// Judges.
///
/// Not good: a run cannot start, there is no real-time priority, the timer is too coarse, a drive would have braked by itself (three
/// periods lost at once), more than 60 late ticks a minute, every hundredth tick half a period late, or waking three threads takes
/// longer than the deadline. Usable: any late tick, the longest lateness above 500 us or every thousandth above 200 us, memory not
/// locked, or waking three threads takes more than half the deadline. Else good.
#[must_use]
pub fn evaluate(checks: &MachineChecks, measured: &Measurement) -> Evaluation {
    let minutes = measured.seconds / 60.0;
    let per_minute = if minutes > 0.0 { measured.late_ticks as f64 / minutes } else { 0.0 };
    // The rule of three: what was not seen in a time is rarer than three in that time, with 95 % certainty.
    let below = (measured.late_ticks == 0 && minutes > 0.0).then(|| 3.0 / minutes);
    let against = against(checks, measured, per_minute);
    let short = shortcomings(measured, per_minute);
    let (grade, reasons) = match (against.is_empty(), short.is_empty()) {
        (false, _) => (Grade::NotGood, against),
        (true, false) => (Grade::Usable, short),
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

/// What makes a machine unfit, worst first.
fn against(checks: &MachineChecks, m: &Measurement, per_minute: f64) -> Vec<String> {
    let bad = |subject| checks.get(subject).filter(|check| check.level == Level::Bad);
    let mut all = Vec::new();
    for subject in [Subject::Kernel, Subject::SharedMemory, Subject::OpenFiles] {
        if let Some(check) = bad(subject) {
            all.push(format!("a run needs more than it finds ({}: {}; wanted: {})", subject.name(), check.found, check.wanted));
        }
    }
    if m.brakes > 0 {
        all.push(format!("a drive would have braked {} in {:.0} s (three periods lost at once)", times(m.brakes), m.seconds));
    }
    if per_minute > MOST_LATE_PER_MINUTE {
        all.push(format!("{per_minute:.0} late ticks a minute, expected {MOST_LATE_PER_MINUTE:.0} at most"));
    }
    if m.lateness_us.p99 > P99_AT_MOST_US {
        all.push(format!("every hundredth tick is {:.0} us late, expected {P99_AT_MOST_US:.0} at most", m.lateness_us.p99));
    }
    if let Some(chain) = chain_us(m).filter(|chain| *chain > DEADLINE_US) {
        all.push(format!("waking three threads takes {chain:.0} us at times, expected {DEADLINE_US:.0} at most"));
    }
    if let Some(check) = bad(Subject::Resolution) {
        all.push(format!("its timers go off in steps of {}, expected {}", check.found, check.wanted));
    }
    if !m.fifo {
        all.push("its threads get no real-time priority, so any program may hold them up".to_owned());
    }
    all
}

/// What keeps a machine that is fit from being good.
fn shortcomings(m: &Measurement, per_minute: f64) -> Vec<String> {
    let q = &m.lateness_us;
    let mut all = Vec::new();
    if m.late_ticks > 0 {
        all.push(format!("{} late ticks in {:.0} s: {per_minute:.0} a minute", m.late_ticks, m.seconds));
    }
    if q.max > MARGIN_US {
        all.push(format!("the latest tick was {:.0} us late, expected {MARGIN_US:.0} at most", q.max));
    }
    if q.p999 > MARGIN_P999_US {
        all.push(format!("every thousandth tick is {:.0} us late, expected {MARGIN_P999_US:.0} at most", q.p999));
    }
    if let Some(chain) = chain_us(m).filter(|chain| *chain > DEADLINE_US / 2.0) {
        all.push(format!("waking three threads takes {chain:.0} us at times, expected {:.0} at most", DEADLINE_US / 2.0));
    }
    if !m.locked {
        all.push("its memory is not locked, so a tick may wait for a page".to_owned());
    }
    all
}

/// What the chain's wake-ups take at times, us: three of the slowest hundredth.
fn chain_us(m: &Measurement) -> Option<f64> {
    m.wake_same_core_us.map(|q| WAKE_UPS * q.p99)
}

fn times(count: u64) -> String {
    if count == 1 { "once".to_owned() } else { format!("{count} times") }
}

#[cfg(test)]
mod tests {
    use super::super::change::MOST;
    use super::super::samples::{all_at, good_measurement, late_measurement, with};
    use super::*;
    use hapfic_log::metrics::Quantiles;

    /// One measurement for each way in which it may be worse, with the grade that follows on an otherwise good machine.
    fn worse() -> Vec<(&'static str, Measurement, Grade)> {
        let m = good_measurement();
        let late = |q: Quantiles| Measurement { lateness_us: q, ..m.clone() };
        let wake = |p99| Measurement { wake_same_core_us: Some(Quantiles { p99, ..m.lateness_us }), ..m.clone() };
        let q = m.lateness_us;
        vec![
            ("as good as it gets", m.clone(), Grade::Good),
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
    fn each_measurement_has_the_grade_the_rules_give_it() {
        for (name, m, expected) in worse() {
            let verdict = evaluate(&all_at(Level::Good), &m);
            assert_eq!(verdict.grade, expected, "{name}: {}", verdict.line);
            assert_eq!(verdict.reasons.is_empty(), expected == Grade::Good, "{name}: {:?}", verdict.reasons);
        }
    }

    /// Every check at every level, with every measurement: only the deciding checks decide, and no worse machine has a better grade.
    #[test]
    fn only_the_deciding_facts_decide() {
        let deciding = [Subject::Kernel, Subject::SharedMemory, Subject::OpenFiles, Subject::Resolution];
        let subjects: Vec<Subject> = all_at(Level::Good).0.iter().map(|check| check.subject).collect();
        for (name, m, alone) in worse() {
            for &subject in &subjects {
                for level in [Level::Good, Level::Fair, Level::Bad, Level::Unknown] {
                    let verdict = evaluate(&with(&all_at(Level::Good), subject, level), &m);
                    let unfit = deciding.contains(&subject) && level == Level::Bad;
                    assert_eq!(verdict.grade, if unfit { Grade::NotGood } else { alone }, "{name}, {subject:?} {level:?}");
                }
            }
        }
    }

    /// Any two ways of being worse together: never better than either.
    #[test]
    fn two_troubles_are_no_better_than_one() {
        for (a_name, a, a_grade) in worse() {
            for (b_name, b, b_grade) in worse() {
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
    fn the_line_says_what_to_expect() {
        let line = |m: &Measurement| evaluate(&all_at(Level::Good), m).line;
        let m = good_measurement();
        assert_eq!(line(&m), "good: 1 kHz with margin; no late tick in 10 s (fewer than 18.0 a minute, with 95 % certainty)");
        assert_eq!(line(&Measurement { late_ticks: 2, ..m.clone() }), "usable: expect 12 late ticks a minute");
        let unlocked = line(&Measurement { locked: false, ..m.clone() });
        assert!(unlocked.starts_with("usable: no late tick in 10 s"), "{unlocked}");
        let long = Measurement { seconds: 600.0, ..m.clone() };
        assert_eq!(evaluate(&all_at(Level::Good), &long).late_ticks_per_minute_below, Some(0.3));
        let braked = line(&Measurement { late_ticks: 5, brakes: 1, ..m });
        assert_eq!(braked, "not for a real robot: a drive would have braked once in 10 s (three periods lost at once)");
    }

    #[test]
    fn a_run_that_cannot_start_is_named_before_all_else() {
        let checks = with(&all_at(Level::Good), Subject::SharedMemory, Level::Bad);
        let verdict = evaluate(&checks, &Measurement { fifo: false, ..late_measurement() });
        assert!(verdict.line.contains("shared memory"), "{}", verdict.line);
        assert_eq!(verdict.changes[0].subject, Subject::SharedMemory);
        assert!(verdict.reasons.len() > 1 && verdict.changes.len() <= MOST);
    }

    #[test]
    fn a_machine_that_tells_nothing_is_judged_by_the_measurement() {
        assert_eq!(evaluate(&MachineChecks::default(), &good_measurement()).grade, Grade::Good);
        assert_eq!(evaluate(&all_at(Level::Unknown), &late_measurement()).grade, Grade::NotGood);
    }
}
