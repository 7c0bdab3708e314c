//! What is so, or not, over time: who touches whom, what mode the drive is in.

use crate::{LATEST_TICK, seconds};

/// Most stretches of a lane. Full, those closest to each other are joined.
pub const MOST_SPANS: usize = 2048;
/// Most lanes; a foreign log may hold any number of names.
pub const MOST_LANES: usize = 48;

/// When something was so: stretches of ticks, both ends included.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Spans {
    /// Stretches that are no further apart than this many ticks are one.
    gap: i64,
    spans: Vec<(i64, i64)>,
}

impl Default for Spans {
    fn default() -> Self {
        Self { gap: 1, spans: Vec::new() }
    }
}

impl Spans {
    /// It was so at this tick. Ticks come in order; one that does not is left out.
    pub fn push(&mut self, tick: i64) {
        if !(0..=LATEST_TICK).contains(&tick) {
            return;
        }
        match self.spans.last_mut() {
            Some((_, to)) if tick <= *to => {}
            Some((_, to)) if tick - *to <= self.gap => *to = tick,
            _ => self.spans.push((tick, tick)),
        }
        while self.spans.len() > MOST_SPANS {
            self.gap *= 2;
            let gap = self.gap;
            let mut joined: Vec<(i64, i64)> = Vec::with_capacity(MOST_SPANS + 1);
            for (from, to) in self.spans.drain(..) {
                match joined.last_mut() {
                    Some(last) if from - last.1 <= gap => last.1 = to,
                    _ => joined.push((from, to)),
                }
            }
            self.spans = joined;
        }
    }

    /// Stretches from their first tick to the end of their last, s.
    #[must_use]
    pub fn seconds(&self) -> Vec<(f64, f64)> {
        self.spans.iter().map(|(from, to)| (seconds(*from), seconds(to + 1))).collect()
    }
}

/// One lane for each pair of names that has come, in the order in which they came.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Lanes {
    lanes: Vec<(String, String, Spans)>,
}

impl Lanes {
    /// A pair at a tick. Returns whether it is new.
    pub fn push(&mut self, first: &str, second: &str, tick: i64) -> bool {
        if let Some((_, _, spans)) = self.lanes.iter_mut().find(|(a, b, _)| a == first && b == second) {
            spans.push(tick);
            return false;
        }
        if self.lanes.len() == MOST_LANES {
            return false;
        }
        let mut spans = Spans::default();
        spans.push(tick);
        self.lanes.push((first.to_owned(), second.to_owned(), spans));
        true
    }

    /// The lanes: the pair, and when it was.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &str, &Spans)> {
        self.lanes.iter().map(|(a, b, spans)| (a.as_str(), b.as_str(), spans))
    }

    /// Whether nothing has come.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lanes.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_in_a_row_are_one_stretch() {
        let mut spans = Spans::default();
        for tick in [3, 4, 5, 9, 10, 10, 2] {
            spans.push(tick);
        }
        assert_eq!(spans.seconds(), [(0.003, 0.006), (0.009, 0.011)]);
    }

    #[test]
    fn chatter_stays_bounded_and_keeps_its_ends() {
        let mut spans = Spans::default();
        for tick in (0..3_600_000).step_by(2) {
            spans.push(tick);
        }
        spans.push(5_000_000);
        assert!(spans.spans.len() <= MOST_SPANS);
        assert_eq!(spans.spans.first().map(|span| span.0), Some(0));
        assert_eq!(spans.spans.last(), Some(&(5_000_000, 5_000_000)));
    }

    #[test]
    fn lanes_are_bounded_and_say_what_is_new() {
        let mut lanes = Lanes::default();
        assert!(lanes.push("foot", "floor", 1));
        assert!(!lanes.push("foot", "floor", 2));
        for i in 0..1000 {
            lanes.push("foot", &format!("thing {i}"), 3);
        }
        assert_eq!(lanes.iter().count(), MOST_LANES);
    }
}
