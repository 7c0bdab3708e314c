//! The last few messages of a topic, by tick.
//!
//! Whoever is a little late finds messages in his queue that are ahead of the tick he works on. Taking the newest would make the
//! result depend on timing; a [`Recent`] gives the one that belongs to the tick.

use crate::message::{Command, Reference, Request, State};

/// Messages kept.
const KEPT: usize = 4;

/// A message that belongs to a tick.
pub trait Ticked {
    /// The tick.
    fn tick(&self) -> i64;
}

macro_rules! ticked {
    ($($kind:ty),+) => { $(impl Ticked for $kind { fn tick(&self) -> i64 { self.tick } })+ };
}
ticked!(Command, Reference, Request, State);

/// The last four messages that came.
#[derive(Clone, Copy, Debug)]
pub struct Recent<T> {
    kept: [Option<T>; KEPT],
    next: usize,
}

impl<T> Default for Recent<T> {
    fn default() -> Self {
        Self { kept: [const { None }; KEPT], next: 0 }
    }
}

impl<T: Ticked> Recent<T> {
    /// Keeps a message, in place of the oldest.
    pub fn keep(&mut self, message: T) {
        self.kept[self.next] = Some(message);
        self.next = (self.next + 1) % KEPT;
    }

    /// The message of a tick, if it is among those kept.
    #[must_use]
    pub fn at(&self, tick: i64) -> Option<&T> {
        self.kept.iter().flatten().find(|m| m.tick() == tick)
    }

    /// The newest message of a tick before this one.
    #[must_use]
    pub fn before(&self, tick: i64) -> Option<&T> {
        self.kept.iter().flatten().filter(|m| m.tick() < tick).max_by_key(|m| m.tick())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_message_from_ahead_does_not_stand_for_its_tick() {
        let mut recent = Recent::<Command>::default();
        for tick in -1..6 {
            recent.keep(Command { tick, ..Command::default() });
        }
        assert_eq!(recent.before(5).unwrap().tick, 4);
        assert_eq!(recent.at(5).unwrap().tick, 5);
        assert!(recent.at(1).is_none(), "only four are kept");
        assert!(recent.before(2).is_none());
    }
}
