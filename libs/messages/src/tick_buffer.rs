//! Buffer of the last few messages of a topic, by tick.
//!
//! The queue of a late process holds messages ahead of the tick that it works on. Taking the newest would make the
//! result depend on timing; a [`TickBuffer`] gives the message of the tick.

use crate::{CONTROL_DEPTH, Command, Reference, Request, State};

/// Most messages in a buffer.
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

/// Messages of the newest received ticks, as many as a control input keeps.
#[derive(Clone, Copy, Debug)]
pub struct TickBuffer<T> {
    /// Ticks of the messages, apart from them: a search is time-critical, and so touches a single cache line.
    ticks: [i64; CAPACITY],
    messages: [Option<T>; CAPACITY],
}

/// Tick of an empty place: before all others.
const NEVER: i64 = i64::MIN;

impl<T> Default for TickBuffer<T> {
    fn default() -> Self {
        Self { ticks: [NEVER; CAPACITY], messages: [const { None }; CAPACITY] }
    }
}

impl<T: Ticked> TickBuffer<T> {
    /// Inserts a message in place of that of the same tick, or else of the oldest tick.
    ///
    /// Leaves out a message older than all in the buffer: after a restart the history of a predecessor may come last.
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

    /// All messages, in no order.
    pub fn iter(&self) -> impl Iterator<Item = &T> {
        self.messages.iter().flatten()
    }

    /// The message of the newest tick.
    #[must_use]
    pub fn newest(&self) -> Option<&T> {
        self.last(|_| true)
    }

    /// The message of a tick, if the buffer holds it.
    #[must_use]
    pub fn at(&self, tick: i64) -> Option<&T> {
        self.ticks.iter().position(|t| *t == tick).and_then(|place| self.messages[place].as_ref())
    }

    /// The newest message of a tick before `tick`.
    #[must_use]
    pub fn before(&self, tick: i64) -> Option<&T> {
        self.last(|t| t < tick)
    }

    /// The oldest message of a tick after `tick`.
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
    fn tick_buffer_look_up_matches_tick() {
        let mut buffer = TickBuffer::<Command>::default();
        for tick in -1..10 {
            buffer.insert(Command { tick, ..Command::default() });
        }
        assert_eq!(buffer.before(5).unwrap().tick, 4);
        assert_eq!(buffer.at(5).unwrap().tick, 5);
        assert!(buffer.at(1).is_none(), "it holds only eight");
        assert!(buffer.before(2).is_none());
        assert_eq!(buffer.after(5).unwrap().tick, 6);
        assert_eq!(buffer.after(-5).unwrap().tick, 2);
        assert!(buffer.after(9).is_none());
        assert!(TickBuffer::<Command>::default().after(i64::MIN).is_none());
    }

    #[test]
    fn tick_buffer_older_history_keeps_newer_messages() {
        let mut buffer = TickBuffer::<Command>::default();
        for tick in (86..94).chain([3, 4, 5, 6, 92]) {
            buffer.insert(Command { tick, ..Command::default() });
        }
        let mut ticks: Vec<_> = buffer.iter().map(|c| c.tick).collect();
        ticks.sort_unstable();
        assert_eq!(ticks, (86..94).collect::<Vec<_>>());
        assert_eq!(buffer.newest().unwrap().tick, 93);
    }
}
