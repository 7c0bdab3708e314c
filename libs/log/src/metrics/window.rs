//! Collects the messages of each tick.

use super::sample::{CommandSample, ReferenceSample, StateSample};

/// Largest lead of a topic over another [ticks].
pub const WINDOW: i64 = 1024;

/// Messages of one tick so far.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TickSamples {
    pub(super) tick: i64,
    pub(super) state: Option<StateSample>,
    pub(super) reference: Option<ReferenceSample>,
    pub(super) command: Option<CommandSample>,
}

/// The last [`WINDOW`] ticks. A new tick displaces the oldest.
#[derive(Clone, Debug)]
pub(super) struct Window {
    slots: Vec<Option<TickSamples>>,
    /// The oldest tick that can still be added; `None` before the first.
    oldest: Option<i64>,
}

impl Default for Window {
    fn default() -> Self {
        Self { slots: vec![None; WINDOW as usize], oldest: None }
    }
}

impl Window {
    /// Returns the slot of a tick; `None` if the tick has already left. Displaced slots are passed to `leave`.
    pub(super) fn slot(&mut self, tick: i64, leave: impl FnMut(TickSamples)) -> Option<&mut TickSamples> {
        // The first message need not be of the first tick: the planner is one tick ahead.
        let oldest = *self.oldest.get_or_insert(tick.saturating_sub(WINDOW / 2));
        if tick < oldest {
            return None;
        }
        let needed = tick.saturating_sub(WINDOW - 1);
        if needed > oldest {
            self.release(oldest, needed, leave);
        }
        Some(self.slots[index(tick)].get_or_insert(TickSamples { tick, ..TickSamples::default() }))
    }

    /// Passes all remaining slots to `leave`.
    pub(super) fn drain(mut self, leave: impl FnMut(TickSamples)) {
        if let Some(oldest) = self.oldest {
            self.release(oldest, oldest.saturating_add(WINDOW), leave);
        }
    }

    /// Releases the ticks `from..until`. At most [`WINDOW`] of them are stored.
    fn release(&mut self, from: i64, until: i64, mut leave: impl FnMut(TickSamples)) {
        for tick in from..until.min(from.saturating_add(WINDOW)) {
            if let Some(slot) = self.slots[index(tick)].take() {
                leave(slot);
            }
        }
        self.oldest = Some(until);
    }
}

fn index(tick: i64) -> usize {
    tick.rem_euclid(WINDOW) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn window_unordered_ticks_leave_in_order() {
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
