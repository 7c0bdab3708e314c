//! Incidents: periods with a braking or stopped drive.

use crate::events::LoggedEvent;
use crate::{LATEST_TICK, seconds};
use hapfic_messages::Severity;
use serde::Serialize;

/// Most incidents in a list; all are counted.
pub const MAX_INCIDENTS: usize = 500;
/// Longest time from the cause to the incident [ticks].
const CAUSE_TICKS: i64 = 50;
/// Kinds of events that can begin an incident.
const CAUSES: [&str; 4] = ["lost", "rejected", "missed", "injected"];

/// Incident: from the first command with severity brake or stopped until the severity is nominal again.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Incident {
    /// First tick.
    pub from_tick: i64,
    /// Last tick.
    pub to_tick: i64,
    /// Start [s].
    pub from_s: f64,
    /// End [s].
    pub to_s: f64,
    /// Worst severity: `brake` or `stopped`.
    pub worst: String,
    /// Whether the incident ended before the log.
    pub recovered: bool,
    /// Cause as text; `None` if no event of the log shows it.
    pub cause: Option<String>,
}

/// Incidents of a log, from its commands.
#[derive(Clone, Debug, Default)]
pub(crate) struct Incidents {
    periods: Vec<Period>,
    total: u64,
    last: Option<i64>,
    open: bool,
}

#[derive(Clone, Copy, Debug)]
struct Period {
    from: i64,
    to: i64,
    worst: Severity,
    recovered: bool,
}

impl Incidents {
    /// Adds the severity of a command. Ticks out of order are ignored.
    pub(crate) fn push(&mut self, tick: i64, severity: &str) {
        let Some(severity) = Severity::from_name(severity) else { return };
        if !(0..=LATEST_TICK).contains(&tick) || self.last.is_some_and(|last| tick <= last) {
            return;
        }
        self.last = Some(tick);
        if !self.open && severity >= Severity::Brake {
            self.open = true;
            self.total += 1;
            if self.periods.len() < MAX_INCIDENTS {
                self.periods.push(Period { from: tick, to: tick, worst: severity, recovered: false });
            }
        }
        if !self.open {
            return;
        }
        let nominal = severity == Severity::Nominal;
        self.open = !nominal;
        // An incident beyond the list is only counted.
        if self.total > self.periods.len() as u64 {
            return;
        }
        if let Some(period) = self.periods.last_mut() {
            period.recovered = nominal;
            if !nominal {
                period.to = tick;
                period.worst = period.worst.max(severity);
            }
        }
    }

    /// Number of incidents.
    pub(crate) fn total(&self) -> u64 {
        self.total
    }

    /// Lists the incidents, with their causes among `events`, which are in the order of time.
    pub(crate) fn listed(&self, events: &[LoggedEvent]) -> Vec<Incident> {
        let mut after = -1;
        let incident = |period: &Period| {
            let Period { from, to, worst, recovered } = *period;
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
        self.periods.iter().map(incident).collect()
    }
}

/// Finds the first event between two ticks that can begin an incident. A request of the operator takes precedence.
fn cause(events: &[LoggedEvent], first: i64, last: i64) -> Option<String> {
    let between = events.iter().filter(|event| (first..=last).contains(&event.tick));
    let transition =
        between.clone().find(|event| event.kind == "transition" && matches!(event.severity.as_str(), "brake" | "stopped"));
    let requested = transition.filter(|event| event.detector == "operator");
    let fault = || between.clone().find(|event| CAUSES.contains(&event.kind.as_str()));
    let event = requested.or_else(fault).or(transition)?;
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
    fn incident_lasts_until_severity_is_nominal() {
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
        let found: Vec<_> = listed.iter().map(|i| (i.from_tick, i.to_tick, i.worst.as_str(), i.recovered)).collect();
        assert_eq!(found, [(2, 5, "stopped", true), (8, 8, "brake", false)]);
        assert_eq!((listed[0].from_s, listed[0].to_s, &listed[0].cause), (0.002, 0.006, &None));
    }

    #[test]
    fn incident_cause_is_first_fault_since_previous_incident() {
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
    fn incidents_flood_is_counted_and_bounded() {
        let mut incidents = Incidents::default();
        for tick in 0..10_000 {
            incidents.push(tick, if tick % 2 == 0 { "nominal" } else { "brake" });
        }
        let listed = incidents.listed(&[]);
        assert_eq!((incidents.total(), listed.len()), (5000, MAX_INCIDENTS));
        assert!(listed.iter().all(|incident| incident.from_tick == incident.to_tick && incident.recovered));
    }
}
