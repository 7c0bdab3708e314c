//! The last few messages of a topic, by tick.
//!
//! Whoever is a little late finds messages in his queue that are ahead of the tick he works on. Taking the newest would make the
//! result depend on timing; a [`TickBuffer`] gives the one that belongs to the tick.

use crate::{CONTROL_DEPTH, Command, Reference, Request, State};

/// Messages messages.
const CAPACITY: usize = CONTROL_DEPTH;

/// A message that belongs to a tick.
pub trait Ticked {
    /// The tick.
    fn tick(&self) -> i64;
}

macro_rules! ticked {
    ($($kind:ty),+) => { $(impl Ticked for $kind { fn tick(&self) -> i64 { self.tick } })+ };
}
ticked!(Command, Reference, Request, State);

/// The messages of the newest ticks that came, as many as a control input keeps.
#[derive(Clone, Copy, Debug)]
pub struct TickBuffer<T> {
    /// The ticks of those messages, apart from them: they are looked through while somebody waits, and lie on one cache line.
    ticks: [i64; CAPACITY],
    messages: [Option<T>; CAPACITY],
}

/// The tick of an empty place: before all others.
const NEVER: i64 = i64::MIN;

impl<T> Default for TickBuffer<T> {
    fn default() -> Self {
        Self { ticks: [NEVER; CAPACITY], messages: [const { None }; CAPACITY] }
    }
}

impl<T: Ticked> TickBuffer<T> {
    /// Keeps a message in place of the one of the same tick, or of the oldest tick. One that is older than all those messages is left
    /// out: after a restart the history of a forerunner may come last.
    pub fn insert(&mut self, message: T) {
        let tick = message.tick();
        let same = self.ticks.iter().position(|t| *t == tick);
        let place = same.or_else(|| (0..CAPACITY).min_by_key(|&i| self.ticks[i]));
        if let Some(place) = place
            && self.ticks[place] <= tick
        {
            self.ticks[place] = tick;
            self.messages[place] = Some(message);
        }
    }

    /// Those messages, in no order.
    pub fn iter(&self) -> impl Iterator<Item = &T> {
        self.messages.iter().flatten()
    }

    /// The message of the newest tick.
    #[must_use]
    pub fn newest(&self) -> Option<&T> {
        self.last(|_| true)
    }

    /// The message of a tick, if it is among those messages.
    #[must_use]
    pub fn at(&self, tick: i64) -> Option<&T> {
        self.ticks.iter().position(|t| *t == tick).and_then(|place| self.messages[place].as_ref())
    }

    /// The newest message of a tick before this one.
    #[must_use]
    pub fn before(&self, tick: i64) -> Option<&T> {
        self.last(|t| t < tick)
    }

    /// The oldest message of a tick after this one.
    #[must_use]
    pub fn after(&self, tick: i64) -> Option<&T> {
        let place = (0..CAPACITY).filter(|&i| self.ticks[i] > tick).min_by_key(|&i| self.ticks[i])?;
        self.messages[place].as_ref()
    }

    fn last(&self, wanted: impl Fn(i64) -> bool) -> Option<&T> {
        let place = (0..CAPACITY).filter(|&i| wanted(self.ticks[i])).max_by_key(|&i| self.ticks[i])?;
        self.messages[place].as_ref()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_message_from_ahead_does_not_stand_for_its_tick() {
        let mut recent = TickBuffer::<Command>::default();
        for tick in -1..10 {
            recent.insert(Command { tick, ..Command::default() });
        }
        assert_eq!(recent.before(5).unwrap().tick, 4);
        assert_eq!(recent.at(5).unwrap().tick, 5);
        assert!(recent.at(1).is_none(), "only eight are messages");
        assert!(recent.before(2).is_none());
        assert_eq!(recent.after(5).unwrap().tick, 6);
        assert_eq!(recent.after(-5).unwrap().tick, 2);
        assert!(recent.after(9).is_none());
        assert!(TickBuffer::<Command>::default().after(i64::MIN).is_none());
    }

    #[test]
    fn the_history_of_a_forerunner_does_not_drive_out_what_is_newer() {
        let mut recent = TickBuffer::<Command>::default();
        for tick in (86..94).chain([3, 4, 5, 6, 92]) {
            recent.insert(Command { tick, ..Command::default() });
        }
        let mut ticks: Vec<_> = recent.iter().map(|c| c.tick).collect();
        ticks.sort_unstable();
        assert_eq!(ticks, (86..94).collect::<Vec<_>>());
        assert_eq!(recent.newest().unwrap().tick, 93);
    }
}
