//! Stretches in which the drive braked or was stopped because something was wrong.

use crate::events::LoggedEvent;
use crate::{LATEST_TICK, seconds};
use hapfic_messages::Severity;
use serde::Serialize;

/// Most incidents that are listed; all are counted.
pub const MOST_INCIDENTS: usize = 500;
/// How long before an incident its cause may lie, ticks.
const CAUSE_TICKS: i64 = 50;
/// Kinds of events that an incident may begin with.
const CAUSES: [&str; 4] = ["lost", "rejected", "missed", "injected"];

/// An incident: from the first command with severity brake or stopped on until the severity is nominal again.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Incident {
    /// Its first tick.
    pub from_tick: i64,
    /// Its last tick.
    pub to_tick: i64,
    /// When it began, s.
    pub from_s: f64,
    /// When it was over, s.
    pub to_s: f64,
    /// `brake` or `stopped`: the worse of those that came.
    pub worst: String,
    /// Whether it was over before the log was.
    pub recovered: bool,
    /// What began it, in words; `None` if no event of the log says so.
    pub cause: Option<String>,
}

/// The incidents of a log, as its commands tell them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Incidents {
    stretches: Vec<Stretch>,
    total: u64,
    last: Option<i64>,
    open: bool,
}

#[derive(Clone, Copy, Debug)]
struct Stretch {
    from: i64,
    to: i64,
    worst: Severity,
    recovered: bool,
}

impl Incidents {
    /// Takes the severity of a command. Ticks come in order; one that does not is left out.
    pub(crate) fn push(&mut self, tick: i64, severity: &str) {
        let Some(severity) = Severity::from_name(severity) else { return };
        if !(0..=LATEST_TICK).contains(&tick) || self.last.is_some_and(|last| tick <= last) {
            return;
        }
        self.last = Some(tick);
        if !self.open && severity >= Severity::Brake {
            self.open = true;
            self.total += 1;
            if self.stretches.len() < MOST_INCIDENTS {
                self.stretches.push(Stretch { from: tick, to: tick, worst: severity, recovered: false });
            }
        }
        if !self.open {
            return;
        }
        let nominal = severity == Severity::Nominal;
        self.open = !nominal;
        // Of one that is not listed there is nothing to be kept.
        if self.total > self.stretches.len() as u64 {
            return;
        }
        if let Some(stretch) = self.stretches.last_mut() {
            stretch.recovered = nominal;
            if !nominal {
                stretch.to = tick;
                stretch.worst = stretch.worst.max(severity);
            }
        }
    }

    /// How many there were.
    pub(crate) fn total(&self) -> u64 {
        self.total
    }

    /// Those that are listed, with their causes among these events, which are in the order of time.
    pub(crate) fn listed(&self, events: &[LoggedEvent]) -> Vec<Incident> {
        let mut after = -1;
        let tell = |stretch: &Stretch| {
            let Stretch { from, to, worst, recovered } = *stretch;
            let cause = cause(events, from.saturating_sub(CAUSE_TICKS).max(after), from);
            after = to.saturating_add(1);
            Incident {
                from_tick: from,
                to_tick: to,
                from_s: seconds(from),
                to_s: seconds(to.saturating_add(1)),
                worst: worst.name().to_owned(),
                recovered,
                cause,
            }
        };
        self.stretches.iter().map(tell).collect()
    }
}

/// The first event between two ticks that an incident may have begun with. If it was asked for, that it was.
fn cause(events: &[LoggedEvent], first: i64, last: i64) -> Option<String> {
    let between = events.iter().filter(|event| (first..=last).contains(&event.tick));
    let transition =
        between.clone().find(|event| event.kind == "transition" && matches!(event.severity.as_str(), "brake" | "stopped"));
    let asked = transition.filter(|event| event.detector == "operator");
    let fault = || between.clone().find(|event| CAUSES.contains(&event.kind.as_str()));
    let event = asked.or_else(fault).or(transition)?;
    Some(format!("{} {}: {}", event.process, event.kind, event.text))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(tick: i64, kind: &str, severity: &str, detector: &str) -> LoggedEvent {
        LoggedEvent {
            time_s: seconds(tick),
            tick,
            process: "controller".to_owned(),
            kind: kind.to_owned(),
            severity: severity.to_owned(),
            detector: detector.to_owned(),
            text: format!("of {tick}"),
            fault: true,
        }
    }

    fn run(severities: &[(i64, &str)]) -> Incidents {
        let mut incidents = Incidents::default();
        for (tick, severity) in severities {
            incidents.push(*tick, severity);
        }
        incidents
    }

    #[test]
    fn an_incident_lasts_until_all_is_well() {
        let incidents = run(&[
            (0, "nominal"),
            (1, "degraded"),
            (2, "brake"),
            (3, "stopped"),
            (2, "nominal"),
            (4, "brake"),
            (5, "degraded"),
            (6, "nominal"),
            (7, "degraded"),
            (8, "brake"),
        ]);
        let listed = incidents.listed(&[]);
        let told: Vec<_> = listed.iter().map(|i| (i.from_tick, i.to_tick, i.worst.as_str(), i.recovered)).collect();
        assert_eq!(told, [(2, 5, "stopped", true), (8, 8, "brake", false)]);
        assert_eq!((listed[0].from_s, listed[0].to_s, &listed[0].cause), (0.002, 0.006, &None));
    }

    #[test]
    fn the_cause_is_the_first_fault_shortly_before_and_not_one_of_the_incident_before() {
        let incidents = run(&[(100, "brake"), (101, "nominal"), (120, "brake"), (121, "nominal"), (200, "stopped")]);
        let events = [
            event(49, "lost", "nominal", "exit"),
            event(50, "missed", "degraded", "deadline"),
            event(60, "lost", "degraded", "exit"),
            event(100, "transition", "brake", "deadline"),
            event(120, "transition", "brake", "deadline"),
            event(190, "missed", "degraded", "deadline"),
            event(200, "transition", "stopped", "operator"),
        ];
        let causes: Vec<_> = incidents.listed(&events).into_iter().map(|incident| incident.cause.unwrap_or_default()).collect();
        assert_eq!(causes, ["controller missed: of 50", "controller transition: of 120", "controller transition: of 200"]);
    }

    #[test]
    fn a_flood_is_counted_and_bounded() {
        let mut incidents = Incidents::default();
        for tick in 0..10_000 {
            incidents.push(tick, if tick % 2 == 0 { "nominal" } else { "brake" });
        }
        let listed = incidents.listed(&[]);
        assert_eq!((incidents.total(), listed.len()), (5000, MOST_INCIDENTS));
        assert!(listed.iter().all(|incident| incident.from_tick == incident.to_tick && incident.recovered));
    }
}
