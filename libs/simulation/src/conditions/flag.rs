//! A condition with a clear beginning and end.

/// State of a condition on one axis or joint.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Flag {
    /// First tick of the present stretch of the opposite observation.
    since: Option<i64>,
    /// Tick at which the condition began; `None` if it does not hold.
    pub(super) began: Option<i64>,
    /// Number of beginnings.
    pub(super) times: u64,
    /// Ticks of the ended conditions.
    ended_ticks: i64,
}

/// A beginning or an end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    Began,
    /// Ended after that many ticks.
    Ended(i64),
}

impl Flag {
    /// Observes a tick: the condition begins or ends once the opposite has been observed for `hold` ticks.
    pub(super) fn observe(&mut self, tick: i64, holds: bool, hold: i64) -> Option<Change> {
        if holds == self.began.is_some() {
            self.since = None;
            return None;
        }
        let since = *self.since.get_or_insert(tick);
        if tick - since < hold {
            return None;
        }
        self.since = None;
        match self.began.take() {
            None => {
                self.began = Some(since);
                self.times += 1;
                Some(Change::Began)
            }
            Some(began) => {
                self.ended_ticks += since - began;
                Some(Change::Ended(since - began))
            }
        }
    }

    /// Ticks for which the condition has held so far.
    pub(super) fn ticks(&self, now: i64) -> i64 {
        self.ended_ticks + self.began.map_or(0, |began| now - began)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flag_begins_and_ends_once_after_its_hold() {
        let mut flag = Flag::default();
        let seen: Vec<_> =
            (0..40).filter_map(|tick| flag.observe(tick, (10..25).contains(&tick), 5).map(|c| (tick, c))).collect();
        assert_eq!(seen, [(15, Change::Began), (30, Change::Ended(15))]);
        assert_eq!((flag.times, flag.ticks(40), flag.began), (1, 15, None));
    }

    #[test]
    fn flag_short_observation_is_none() {
        let mut flag = Flag::default();
        assert!((0..40).all(|tick| flag.observe(tick, tick % 4 != 0, 5).is_none()));
    }
}
