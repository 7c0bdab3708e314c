//! Timelines of states: contact pairs and modes.

use crate::{LATEST_TICK, seconds};

/// Most spans of a row. A full row joins the closest spans.
pub const MAX_SPANS: usize = 2048;
/// Most rows; a log of another program may hold any number of names.
pub const MAX_ROWS: usize = 48;

/// Periods of one state: spans of ticks, both ends included.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Spans {
    /// Largest distance at which spans are joined [ticks].
    gap: i64,
    spans: Vec<(i64, i64)>,
}

impl Default for Spans {
    fn default() -> Self {
        Self { gap: 1, spans: Vec::new() }
    }
}

impl Spans {
    /// Adds a tick. Ticks out of order are ignored.
    pub fn push(&mut self, tick: i64) {
        self.push_span(tick, tick);
    }

    /// Adds the ticks `from..=to`. Those that are out of order are ignored.
    pub(crate) fn push_span(&mut self, from: i64, to: i64) {
        if from < 0 || to > LATEST_TICK || to < from {
            return;
        }
        match self.spans.last_mut() {
            Some((_, last)) if to <= *last => {}
            Some((_, last)) if from - *last <= self.gap => *last = to,
            _ => self.spans.push((from, to)),
        }
        while self.spans.len() > MAX_SPANS {
            self.gap *= 2;
            let gap = self.gap;
            let mut joined: Vec<(i64, i64)> = Vec::with_capacity(MAX_SPANS + 1);
            for (from, to) in self.spans.drain(..) {
                match joined.last_mut() {
                    Some(last) if from - last.1 <= gap => last.1 = to,
                    _ => joined.push((from, to)),
                }
            }
            self.spans = joined;
        }
    }

    /// Spans from their first tick to the end of their last tick [s].
    #[must_use]
    pub fn seconds(&self) -> Vec<(f64, f64)> {
        self.spans.iter().map(|(from, to)| (seconds(*from), seconds(to + 1))).collect()
    }
}

/// Timelines: one row for each pair of names, in the order of their first ticks.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Timelines {
    rows: Vec<(String, String, Spans)>,
}

impl Timelines {
    /// Adds a pair at a tick. Returns whether the pair is new.
    pub fn push(&mut self, first: &str, second: &str, tick: i64) -> bool {
        if let Some((_, _, spans)) = self.rows.iter_mut().find(|(a, b, _)| a == first && b == second) {
            spans.push(tick);
            return false;
        }
        if self.rows.len() == MAX_ROWS {
            return false;
        }
        let mut spans = Spans::default();
        spans.push(tick);
        self.rows.push((first.to_owned(), second.to_owned(), spans));
        true
    }

    /// Rows: the pair and its spans.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &str, &Spans)> {
        self.rows.iter().map(|(a, b, spans)| (a.as_str(), b.as_str(), spans))
    }

    /// Whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_consecutive_ticks_are_joined() {
        let mut spans = Spans::default();
        for tick in [3, 4, 5, 9, 10, 10, 2] {
            spans.push(tick);
        }
        assert_eq!(spans.seconds(), [(0.003, 0.006), (0.009, 0.011)]);
    }

    #[test]
    fn spans_chatter_is_bounded_and_keeps_ends() {
        let mut spans = Spans::default();
        for tick in (0..3_600_000).step_by(2) {
            spans.push(tick);
        }
        spans.push(5_000_000);
        assert!(spans.spans.len() <= MAX_SPANS);
        assert_eq!(spans.spans.first().map(|span| span.0), Some(0));
        assert_eq!(spans.spans.last(), Some(&(5_000_000, 5_000_000)));
    }

    #[test]
    fn timelines_are_bounded_and_report_new_pairs() {
        let mut rows = Timelines::default();
        assert!(rows.push("foot", "floor", 1));
        assert!(!rows.push("foot", "floor", 2));
        for i in 0..1000 {
            rows.push("foot", &format!("thing {i}"), 3);
        }
        assert_eq!(rows.iter().count(), MAX_ROWS);
    }
}
