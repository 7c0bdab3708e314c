//! Puts together what belongs to one tick.

use super::sample::{CommandSample, ReferenceSample, StateSample};

/// Ticks by which topics may run ahead of each other.
pub const WINDOW: i64 = 1024;

/// What has come of one tick.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Slot {
    pub(super) tick: i64,
    pub(super) state: Option<StateSample>,
    pub(super) reference: Option<ReferenceSample>,
    pub(super) command: Option<CommandSample>,
}

/// The last [`WINDOW`] ticks. Each leaves when a tick comes for which there is no more room, oldest first.
#[derive(Clone, Debug)]
pub(super) struct Window {
    slots: Vec<Option<Slot>>,
    /// The oldest tick that may still come; `None` before the first.
    oldest: Option<i64>,
}

impl Default for Window {
    fn default() -> Self {
        Self { slots: vec![None; WINDOW as usize], oldest: None }
    }
}

impl Window {
    /// The slot of a tick; `None` if it has left already. What has to go for it is given to `leave`.
    pub(super) fn slot(&mut self, tick: i64, leave: impl FnMut(Slot)) -> Option<&mut Slot> {
        // The first message need not be of the first tick: the planner is one ahead.
        let oldest = *self.oldest.get_or_insert(tick.saturating_sub(WINDOW / 2));
        if tick < oldest {
            return None;
        }
        let needed = tick.saturating_sub(WINDOW - 1);
        if needed > oldest {
            self.release(oldest, needed, leave);
        }
        Some(self.slots[place(tick)].get_or_insert(Slot { tick, ..Slot::default() }))
    }

    /// Gives all that is left to `leave`.
    pub(super) fn drain(mut self, leave: impl FnMut(Slot)) {
        if let Some(oldest) = self.oldest {
            self.release(oldest, oldest.saturating_add(WINDOW), leave);
        }
    }

    /// Releases the ticks `from..until`. However far apart they are, no more than [`WINDOW`] are held.
    fn release(&mut self, from: i64, until: i64, mut leave: impl FnMut(Slot)) {
        for tick in from..until.min(from.saturating_add(WINDOW)) {
            if let Some(slot) = self.slots[place(tick)].take() {
                leave(slot);
            }
        }
        self.oldest = Some(until);
    }
}

fn place(tick: i64) -> usize {
    tick.rem_euclid(WINDOW) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_leave_in_order_whatever_the_order_of_arrival() {
        let mut window = Window::default();
        let mut left = Vec::new();
        for tick in [3, 1, 2, 0, WINDOW + 6, 5, WINDOW + 5, 10_000, 9_990, i64::MAX / 2] {
            let kept = window.slot(tick, |slot| left.push(slot.tick)).is_some();
            assert!(kept || tick == 5, "tick {tick}");
        }
        window.drain(|slot| left.push(slot.tick));
        assert_eq!(left, [0, 1, 2, 3, WINDOW + 5, WINDOW + 6, 9_990, 10_000, i64::MAX / 2]);
    }
}
