//! Events of a run.

use crate::figure::{Mark, MarkKind};
use crate::{LATEST_TICK, seconds};
use hapfic_log::proto;
use hapfic_messages::Severity;
use serde::Serialize;
use std::collections::BTreeMap;

/// Most events in a list, of each class: faults, changes by the operator, actions of the supervisor, and others. All
/// are counted.
pub const MAX_EVENTS: usize = 500;
/// Kind of a change by the operator.
const PARAMETERS: &str = "parameters";
/// Other kinds of operator actions.
const OPERATOR_ACTIONS: [&str; 1] = ["rearmed"];
/// Kinds of faults.
const FAULTS: [&str; 7] = ["lost", "rejected", "missed", "timebase_slip", "injected", "differs", "passage"];
/// Kinds of supervisor actions, and of their consequences.
const ACTIONS: [&str; 4] = ["promoted", "restarted", "joined", "discontinuity"];
/// Most kinds with a separate count.
const MAX_KINDS: usize = 32;
/// Longest text of an event [characters].
const MAX_TEXT_CHARS: usize = 400;

/// Event of the log, or change by the operator.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LoggedEvent {
    /// Time [s].
    pub time_s: f64,
    /// Tick.
    pub tick: i64,
    /// Process that the event is about.
    pub process: String,
    /// Kind.
    pub kind: String,
    /// Severity.
    pub severity: String,
    /// First detector.
    pub detector: String,
    /// Description.
    pub text: String,
    /// Whether the event is a fault.
    pub fault: bool,
}

/// Events of a log, up to the limits.
#[derive(Clone, Debug, Default)]
pub(crate) struct Events {
    kept: Vec<LoggedEvent>,
    /// Number of kept events, by class.
    kept_of: [usize; 4],
    /// Number of events, by kind.
    counts: BTreeMap<String, u64>,
    total: u64,
    /// Severity of the last transition; `None` before the first.
    severity: Option<Severity>,
}

impl Events {
    /// Adds a message of `/event`.
    pub(crate) fn push(&mut self, event: &proto::Event) {
        // `/operator` has more about a set that takes effect.
        if event.kind == PARAMETERS {
            return;
        }
        let fault = FAULTS.contains(&event.kind.as_str()) || (event.kind == "transition" && self.is_worse(&event.severity));
        self.insert(LoggedEvent {
            time_s: 0.0,
            tick: event.tick,
            process: cut(&event.process),
            kind: cut(&event.kind),
            severity: cut(&event.severity),
            detector: cut(&event.detector),
            text: cut(&event.text),
            fault,
        });
    }

    /// Stores the severity after a transition; returns whether it is worse than before.
    fn is_worse(&mut self, severity: &str) -> bool {
        let Some(now) = Severity::from_name(severity) else { return false };
        now > self.severity.replace(now).unwrap_or(Severity::Nominal)
    }

    /// Adds a change by the operator.
    pub(crate) fn changed(&mut self, tick: i64, version: u64, changes: &str) {
        self.insert(LoggedEvent {
            time_s: 0.0,
            tick,
            process: "operator".to_owned(),
            kind: PARAMETERS.to_owned(),
            severity: "nominal".to_owned(),
            detector: "none".to_owned(),
            text: cut(&format!("set {version}: {changes}")),
            fault: false,
        });
    }

    fn insert(&mut self, event: LoggedEvent) {
        self.total += 1;
        if let Some(count) = self.counts.get_mut(&event.kind) {
            *count += 1;
        } else if self.counts.len() < MAX_KINDS {
            self.counts.insert(event.kind.clone(), 1);
        }
        // Every class has its own limit.
        let class = match mark_kind(&event) {
            Some(MarkKind::Fault) => 0,
            Some(MarkKind::Operator) => 1,
            Some(MarkKind::Action) => 2,
            None => 3,
        };
        if self.kept_of[class] < MAX_EVENTS {
            self.kept_of[class] += 1;
            let tick = event.tick.clamp(0, LATEST_TICK);
            self.kept.push(LoggedEvent { time_s: seconds(tick), ..event });
        }
    }

    /// Sorts the events by time.
    pub(crate) fn sort(&mut self) {
        self.kept.sort_by_key(|event| event.tick);
    }

    /// Kept events.
    pub(crate) fn kept(&self) -> &[LoggedEvent] {
        &self.kept
    }

    /// Number of events, by kind.
    pub(crate) fn counts(&self) -> &BTreeMap<String, u64> {
        &self.counts
    }

    /// Number of events.
    pub(crate) fn total(&self) -> u64 {
        self.total
    }

    /// Marks of the time axes: operator changes, faults, and supervisor actions.
    pub(crate) fn marks(&self) -> Vec<Mark> {
        let mark = |event: &LoggedEvent| {
            let text = format!("{} {}: {}", event.process, event.kind, event.text);
            mark_kind(event).map(|kind| Mark { time_s: event.time_s, kind, text })
        };
        self.kept.iter().filter_map(mark).collect()
    }
}

/// Kind of the mark of an event, if it has one.
fn mark_kind(event: &LoggedEvent) -> Option<MarkKind> {
    let kind = event.kind.as_str();
    if event.fault {
        Some(MarkKind::Fault)
    } else if kind == PARAMETERS || OPERATOR_ACTIONS.contains(&kind) {
        Some(MarkKind::Operator)
    } else {
        ACTIONS.contains(&kind).then_some(MarkKind::Action)
    }
}

fn cut(text: &str) -> String {
    text.chars().take(MAX_TEXT_CHARS).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_flood_of_notes_keeps_faults_and_operator_changes() {
        let mut events = Events::default();
        let event = |kind: &str, tick| proto::Event { tick, kind: kind.to_owned(), ..proto::Event::default() };
        for tick in 0..10_000 {
            events.push(&event("note", tick));
        }
        events.push(&event("lost", 4));
        for tick in 0..600 {
            events.changed(20_000 + tick, tick as u64, "F_d (0, 0, 50) N");
        }
        events.sort();
        assert_eq!(events.kept().len(), 2 * MAX_EVENTS + 1);
        assert_eq!((events.total(), events.counts()["note"], events.counts()["parameters"]), (10_601, 10_000, 600));
        assert_eq!(events.marks().len(), MAX_EVENTS + 1);
        assert_eq!(events.marks().iter().filter(|mark| mark.kind == MarkKind::Fault).count(), 1);
        assert!(events.kept().is_sorted_by_key(|event| event.tick));
    }

    #[test]
    fn events_faults_actions_and_operator_changes_are_marked() {
        let mut events = Events::default();
        let kinds = "lost missed rejected timebase_slip injected differs promoted restarted joined discontinuity rearmed \
                     note limited contact started ended";
        for (tick, kind) in (0..).zip(kinds.split(' ')) {
            events.push(&proto::Event { tick, kind: kind.to_owned(), ..proto::Event::default() });
        }
        let count = |kind: MarkKind| events.marks().iter().filter(|mark| mark.kind == kind).count();
        assert_eq!(MarkKind::ALL.map(count), [1, 4, 6]);
        assert_eq!(events.kept().iter().filter(|event| event.fault).count(), 6);
    }

    #[test]
    fn events_only_transition_to_worse_is_fault() {
        let mut events = Events::default();
        let ladder = ["degraded", "brake", "stopped", "brake", "nominal", "nominal", "brake", "unknown", "degraded", "brake"];
        for (tick, severity) in (0..).zip(ladder) {
            let (kind, severity) = ("transition".to_owned(), severity.to_owned());
            events.push(&proto::Event { tick, kind, severity, ..proto::Event::default() });
        }
        let worse: Vec<_> = events.kept().iter().filter(|event| event.fault).map(|event| event.tick).collect();
        assert_eq!(worse, [0, 1, 2, 6, 9]);
    }
}
