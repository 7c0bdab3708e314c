//! Text of an examination for the terminal.

use super::Examination;
use super::check::Level;
use super::measure::Measurement;
use hapfic_log::metrics::Quantiles;
use std::fmt::Write;

impl Examination {
    /// Formats the examination for the terminal.
    #[must_use]
    pub fn text(&self) -> String {
        let mut out = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut out);
        out
    }

    fn write(&self, out: &mut String) -> std::fmt::Result {
        writeln!(out, "checks of this machine:")?;
        for check in &self.checks.0 {
            writeln!(out, "  {:<18} {:<6} {}", check.subject.name(), check.level.mark(), check.found)?;
            if check.level != Level::Good {
                writeln!(out, "  {:<25} wanted: {}", "", check.wanted)?;
            }
            if let Some(how) = &check.how {
                writeln!(out, "  {:<25} how: {how}", "")?;
            }
        }
        self.measured.write(out)?;
        let verdict = &self.verdict;
        writeln!(out, "verdict: {}", verdict.line)?;
        // The line already has the first reason against a machine.
        let is_new = |reason: &&String| !verdict.line.ends_with(reason.as_str());
        for reason in verdict.reasons.iter().filter(is_new) {
            writeln!(out, "  also: {reason}")?;
        }
        if !verdict.changes.is_empty() {
            writeln!(out, "what to change, most effective first:")?;
        }
        for (index, change) in verdict.changes.iter().enumerate() {
            writeln!(out, "  {}. {}: {}", index + 1, change.subject.name(), change.why)?;
            writeln!(out, "     {}", change.how)?;
        }
        Ok(())
    }
}

impl Measurement {
    fn write(&self, out: &mut String) -> std::fmt::Result {
        let scheduler = match self.fifo {
            true => format!("SCHED_FIFO {}", self.priority),
            false => "SCHED_OTHER, since no real-time priority is allowed".to_owned(),
        };
        let core = self.core.map_or("any core".to_owned(), |core| format!("core {core}"));
        let memory = if self.locked { "memory locked" } else { "memory not locked" };
        let idle = if self.idle_held { ", no deep idle" } else { "" };
        writeln!(out, "measured for {:.0} s on {core}, {scheduler}, {memory}{idle}:", self.seconds)?;
        let q = &self.lateness_us;
        writeln!(
            out,
            "  timer lateness     p50 {:.0}  p99 {:.0}  p99.9 {:.0}  max {:.0} us  (absolute timer, 1 ms)",
            q.p50, q.p99, q.p999, q.max
        )?;
        writeln!(
            out,
            "  ticks              {}; more than 100 us late {}, 500 us {}, 1 ms {}; {} periods lost, three or more in a row {}",
            self.ticks,
            self.over_100_us,
            self.over_500_us,
            self.over_1_ms,
            self.late_ticks,
            match self.brakes {
                0 => "never".to_owned(),
                1 => "once".to_owned(),
                times => format!("{times} times"),
            }
        )?;
        let wake = |q: &Option<Quantiles>| q.map_or("none".to_owned(), |q| format!("p50 {:.0}  p99 {:.0} us", q.p50, q.p99));
        writeln!(
            out,
            "  wake-up by futex   same core {}; another core {}",
            wake(&self.wake_same_core_us),
            wake(&self.wake_other_core_us)
        )?;
        let count = |value: Option<u64>| value.map_or("an unknown number of".to_owned(), |value| value.to_string());
        writeln!(
            out,
            "  meanwhile          {} ms steal time of the core; {} page faults; {} interrupts by devices",
            count(self.steal_ms),
            self.page_faults,
            count(self.interrupts)
        )
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::evaluate;
    use super::super::samples::{all_at, good_measurement, late_measurement};
    use super::{Examination, Level, Measurement};

    fn examination(level: Level, measured: Measurement) -> Examination {
        let checks = all_at(level);
        Examination { verdict: evaluate(&checks, &measured), measured, checks }
    }

    #[test]
    fn text_good_machine_has_no_changes() {
        let text = examination(Level::Good, good_measurement()).text();
        assert!(text.contains("SCHED_FIFO 80") && text.contains("verdict: good: 1 kHz with margin"), "{text}");
        assert!(!text.contains("what to change") && !text.contains("how:") && !text.contains("also:"), "{text}");
    }

    #[test]
    fn text_bad_machine_has_wanted_values_and_instructions() {
        let measured = Measurement { fifo: false, core: None, steal_ms: None, wake_other_core_us: None, ..late_measurement() };
        let text = examination(Level::Bad, measured).text();
        for expected in ["SCHED_OTHER", "any core", "wanted: ", "how: ", "another core none", "  5. ", "an unknown number of ms"]
        {
            assert!(text.contains(expected), "{expected} in:\n{text}");
        }
        assert!(!text.contains("  6. "), "{text}");
    }

    #[test]
    fn json_of_examination_has_verdict_checks_and_measurement() {
        let json = serde_json::to_value(examination(Level::Bad, late_measurement())).unwrap();
        assert_eq!(json["verdict"]["grade"], "not_good");
        assert_eq!(json["checks"][0]["subject"], "kernel");
        assert_eq!(json["checks"][0]["level"], "bad");
        assert_eq!(json["verdict"]["changes"].as_array().unwrap().len(), 5);
        assert!(json["measured"]["lateness_us"]["p999"].is_f64());
    }
}
