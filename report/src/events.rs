//! What happened during a run.

use crate::figure::Mark;
use crate::{LATEST_TICK, seconds};
use hapfic_log::proto;
use serde::Serialize;
use std::collections::BTreeMap;

/// Most events a report lists: so many faults, so many changes by the operator, and so many others; more are counted.
pub const MOST_EVENTS: usize = 500;
/// Kind of a change by the operator.
const PARAMETERS: &str = "parameters";
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
    kept_of: [usize; 3],
    /// How many there were of each kind.
    counts: BTreeMap<String, u64>,
    total: u64,
}

impl Events {
    /// Takes a message of `/event`.
    pub(crate) fn push(&mut self, event: &proto::Event) {
        // A set that takes effect is known better from `/operator`.
        if event.kind == PARAMETERS {
            return;
        }
        let fault = matches!(event.kind.as_str(), "lost" | "refused" | "missed" | "slipped")
            || (event.kind == "transition" && event.severity != "nominal");
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
        let class = if event.fault { 0 } else { 1 + usize::from(event.kind == PARAMETERS) };
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

    /// What time axes mark: what the operator changed, and what went wrong.
    pub(crate) fn marks(&self) -> Vec<Mark> {
        let marked = self.kept.iter().filter(|event| event.fault || event.kind == PARAMETERS);
        marked
            .map(|event| Mark {
                time_s: event.time_s,
                fault: event.fault,
                text: format!("{} {}: {}", event.process, event.kind, event.text),
            })
            .collect()
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
        assert_eq!(events.marks().iter().filter(|mark| mark.fault).count(), 1);
        assert!(events.kept().is_sorted_by_key(|event| event.tick));
    }
}
