//! What happened during a run.

use crate::figure::{Mark, MarkKind};
use crate::{LATEST_TICK, seconds};
use hapfic_log::proto;
use hapfic_messages::Severity;
use serde::Serialize;
use std::collections::BTreeMap;

/// Most events a report lists: so many faults, so many changes by the operator, so many of what the stack did about faults, and so
/// many others; more are counted.
pub const MOST_EVENTS: usize = 500;
/// Kind of a change by the operator.
const PARAMETERS: &str = "parameters";
/// Kinds of what else the operator does.
const BY_OPERATOR: [&str; 1] = ["rearmed"];
/// Kinds of what went wrong.
const FAULTS: [&str; 6] = ["lost", "rejected", "missed", "slipped", "injected", "differs"];
/// Kinds of what the stack did about it, and of what came of it.
const REACTIONS: [&str; 4] = ["promoted", "restarted", "joined", "discontinuity"];
/// Most kinds that are counted one by one.
const MOST_KINDS: usize = 32;
/// Longest text of an event, characters.
const LONGEST_TEXT: usize = 400;

/// An event of the log, or a change by the operator.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LoggedEvent {
    /// When, s.
    pub time_s: f64,
    /// Its tick.
    pub tick: i64,
    /// The process it is about.
    pub process: String,
    /// What it reports.
    pub kind: String,
    /// How bad it is.
    pub severity: String,
    /// Who saw it first.
    pub detector: String,
    /// In words.
    pub text: String,
    /// Whether something went wrong.
    pub fault: bool,
}

/// The events of a log, as many as there is room for.
#[derive(Clone, Debug, Default)]
pub(crate) struct Events {
    kept: Vec<LoggedEvent>,
    /// How many of each class are kept.
    kept_of: [usize; 4],
    /// How many there were of each kind.
    counts: BTreeMap<String, u64>,
    total: u64,
    /// That of the last transition; `None` before the first.
    severity: Option<Severity>,
}

impl Events {
    /// Takes a message of `/event`.
    pub(crate) fn push(&mut self, event: &proto::Event) {
        // A set that takes effect is known better from `/operator`.
        if event.kind == PARAMETERS {
            return;
        }
        let fault = FAULTS.contains(&event.kind.as_str()) || (event.kind == "transition" && self.is_worse(&event.severity));
        self.keep(LoggedEvent {
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

    /// Takes the severity to which a transition leads; says whether it is worse than the one before.
    fn is_worse(&mut self, severity: &str) -> bool {
        let Some(now) = Severity::from_name(severity) else { return false };
        now > self.severity.replace(now).unwrap_or(Severity::Nominal)
    }

    /// Takes a change by the operator.
    pub(crate) fn changed(&mut self, tick: i64, version: u64, changes: &str) {
        self.keep(LoggedEvent {
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

    fn keep(&mut self, event: LoggedEvent) {
        self.total += 1;
        if let Some(count) = self.counts.get_mut(&event.kind) {
            *count += 1;
        } else if self.counts.len() < MOST_KINDS {
            self.counts.insert(event.kind.clone(), 1);
        }
        // A flood of one class leaves the others their places.
        let class = match mark_kind(&event) {
            Some(MarkKind::Fault) => 0,
            Some(MarkKind::Operator) => 1,
            Some(MarkKind::Reaction) => 2,
            None => 3,
        };
        if self.kept_of[class] < MOST_EVENTS {
            self.kept_of[class] += 1;
            let tick = event.tick.clamp(0, LATEST_TICK);
            self.kept.push(LoggedEvent { time_s: seconds(tick), ..event });
        }
    }

    /// Puts them in the order of time.
    pub(crate) fn sort(&mut self) {
        self.kept.sort_by_key(|event| event.tick);
    }

    /// Those that are kept.
    pub(crate) fn kept(&self) -> &[LoggedEvent] {
        &self.kept
    }

    /// How many there were of each kind.
    pub(crate) fn counts(&self) -> &BTreeMap<String, u64> {
        &self.counts
    }

    /// How many there were.
    pub(crate) fn total(&self) -> u64 {
        self.total
    }

    /// What time axes mark: what the operator changed, what went wrong, and what was done about it.
    pub(crate) fn marks(&self) -> Vec<Mark> {
        let mark = |event: &LoggedEvent| {
            let text = format!("{} {}: {}", event.process, event.kind, event.text);
            mark_kind(event).map(|kind| Mark { time_s: event.time_s, kind, text })
        };
        self.kept.iter().filter_map(mark).collect()
    }
}

/// As what time axes mark it, if they do.
fn mark_kind(event: &LoggedEvent) -> Option<MarkKind> {
    let kind = event.kind.as_str();
    if event.fault {
        Some(MarkKind::Fault)
    } else if kind == PARAMETERS || BY_OPERATOR.contains(&kind) {
        Some(MarkKind::Operator)
    } else {
        REACTIONS.contains(&kind).then_some(MarkKind::Reaction)
    }
}

fn cut(text: &str) -> String {
    text.chars().take(LONGEST_TEXT).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_of_notes_leaves_room_for_what_went_wrong_and_for_the_operator() {
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
        assert_eq!(events.kept().len(), 2 * MOST_EVENTS + 1);
        assert_eq!((events.total(), events.counts()["note"], events.counts()["parameters"]), (10_601, 10_000, 600));
        assert_eq!(events.marks().len(), MOST_EVENTS + 1);
        assert_eq!(events.marks().iter().filter(|mark| mark.kind == MarkKind::Fault).count(), 1);
        assert!(events.kept().is_sorted_by_key(|event| event.tick));
    }

    #[test]
    fn what_went_wrong_what_was_done_about_it_and_what_the_operator_did_are_marked() {
        let mut events = Events::default();
        let kinds = "lost missed rejected slipped injected differs promoted restarted joined discontinuity rearmed \
                     note limited contact started ended";
        for (tick, kind) in (0..).zip(kinds.split(' ')) {
            events.push(&proto::Event { tick, kind: kind.to_owned(), ..proto::Event::default() });
        }
        let count = |kind: MarkKind| events.marks().iter().filter(|mark| mark.kind == kind).count();
        assert_eq!(MarkKind::ALL.map(count), [1, 4, 6]);
        assert_eq!(events.kept().iter().filter(|event| event.fault).count(), 6);
    }

    #[test]
    fn only_a_transition_to_worse_is_a_fault() {
        let mut events = Events::default();
        let ladder = ["degraded", "brake", "stopped", "brake", "nominal", "nominal", "brake", "unheard-of", "degraded", "brake"];
        for (tick, severity) in (0..).zip(ladder) {
            let (kind, severity) = ("transition".to_owned(), severity.to_owned());
            events.push(&proto::Event { tick, kind, severity, ..proto::Event::default() });
        }
        let worse: Vec<_> = events.kept().iter().filter(|event| event.fault).map(|event| event.tick).collect();
        assert_eq!(worse, [0, 1, 2, 6, 9]);
    }
}
