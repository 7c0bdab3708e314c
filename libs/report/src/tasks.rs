//! Conditions of the task: when each held. They are no faults of the stack, which may be nominal meanwhile.

use crate::LATEST_TICK;
use crate::timelines::{MAX_ROWS, Spans};
use hapfic_log::proto;
use serde::Serialize;

/// Kind of their events.
const CONDITION: &str = "condition";
/// Separates the name of a condition from what was found, in the text of an event.
const BEGAN: &str = " began: ";
const ENDED: &str = " ended after ";

/// Conditions of a log. A log of another program may name any number; the first [`MAX_ROWS`] count.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tasks {
    rows: Vec<Row>,
}

#[derive(Clone, Debug, Default)]
struct Row {
    name: String,
    began: Option<i64>,
    times: u64,
    ticks: i64,
    spans: Spans,
}

/// Condition of the task over a log.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct TaskSummary {
    /// Name and place, such as `force_not_reached on z`.
    pub(crate) condition: String,
    /// Number of beginnings.
    pub(crate) times: u64,
    /// Time for which it held [s].
    pub(crate) total_s: f64,
}

impl Tasks {
    /// Adds an event; others than beginnings and ends of a condition change nothing.
    pub(crate) fn push(&mut self, event: &proto::Event) {
        if event.kind != CONDITION || !(0..=LATEST_TICK).contains(&event.tick) {
            return;
        }
        if let Some((name, _)) = event.text.split_once(BEGAN) {
            let Some(row) = self.row(name) else { return };
            row.times += 1;
            row.began.get_or_insert(event.tick);
        } else if let Some((name, _)) = event.text.split_once(ENDED)
            && let Some(row) = self.row(name)
        {
            row.end(event.tick);
        }
    }

    fn row(&mut self, name: &str) -> Option<&mut Row> {
        if let Some(at) = self.rows.iter().position(|row| row.name == name) {
            return self.rows.get_mut(at);
        }
        if self.rows.len() == MAX_ROWS {
            return None;
        }
        self.rows.push(Row { name: name.to_owned(), ..Row::default() });
        self.rows.last_mut()
    }

    /// Ends the conditions that hold at the end of the log.
    pub(crate) fn end(&mut self, last_tick: i64) {
        self.rows.iter_mut().for_each(|row| row.end(last_tick + 1));
    }

    /// Rows of a timeline: name and spans.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&str, &Spans)> {
        self.rows.iter().map(|row| (row.name.as_str(), &row.spans))
    }

    pub(crate) fn summary(&self) -> Vec<TaskSummary> {
        let of = |row: &Row| TaskSummary { condition: row.name.clone(), times: row.times, total_s: crate::seconds(row.ticks) };
        self.rows.iter().map(of).collect()
    }
}

impl Row {
    fn end(&mut self, tick: i64) {
        let Some(began) = self.began.take() else { return };
        self.ticks += (tick - began).max(0);
        self.spans.push_span(began, tick - 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(tick: i64, text: &str) -> proto::Event {
        proto::Event { tick, kind: CONDITION.to_owned(), text: text.to_owned(), ..proto::Event::default() }
    }

    #[test]
    fn tasks_from_events_have_times_and_spans() {
        let mut tasks = Tasks::default();
        tasks.push(&event(100, "force_oscillates on z began: rms 10 % of 50.00 N"));
        tasks.push(&event(300, "force_oscillates on z ended after 0.200 s"));
        tasks.push(&event(400, "outside_bound on x began: 30 mm"));
        tasks.push(&event(500, "force_oscillates on z began: rms 10 % of 50.00 N"));
        tasks.push(&proto::Event { kind: "note".to_owned(), ..event(510, "outside_bound on x ended after 1 s") });
        tasks.end(599);
        let summary = |condition: &str, times, total_s| TaskSummary { condition: condition.to_owned(), times, total_s };
        assert_eq!(tasks.summary(), [summary("force_oscillates on z", 2, 0.3), summary("outside_bound on x", 1, 0.2)]);
        let spans: Vec<_> = tasks.iter().map(|(_, spans)| spans.seconds()).collect();
        assert_eq!(spans, [vec![(0.1, 0.3), (0.5, 0.6)], vec![(0.4, 0.6)]]);
    }

    #[test]
    fn tasks_foreign_events_are_bounded() {
        let mut tasks = Tasks::default();
        tasks.push(&event(1, "neither a beginning nor an end"));
        tasks.push(&event(-5, "early began: x"));
        tasks.push(&event(9, "late ended after 3 s"));
        (0..1000).for_each(|i| tasks.push(&event(i, &format!("{i} began: x"))));
        tasks.end(0);
        assert_eq!(tasks.iter().count(), MAX_ROWS);
        assert!(tasks.summary().iter().all(|task| task.total_s >= 0.0));
    }
}
