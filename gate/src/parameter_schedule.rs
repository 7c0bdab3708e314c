//! Schedule of the operator's parameters: announced some ticks ahead, so that all processes change at the same tick.

use hapfic_config::{MIN_SPACING_TICKS, OperatorChange, ParameterSettings, Settings};
use hapfic_controller::parameters::{self, TipPose};
use hapfic_messages::Operator;
use std::collections::VecDeque;

/// Most waiting changes beside the scripted ones. Reserved from the start: the gate does not allocate.
const CAPACITY: usize = 16;

/// Parameter sets in force, announced and waiting.
#[derive(Debug)]
pub struct ParameterSchedule {
    operator: Operator,
    /// Configuration from which `operator.next` was made.
    next: ParameterSettings,
    /// Default target: pose of the foot at the start.
    start: TipPose,
    waiting: VecDeque<OperatorChange>,
}

impl Clone for ParameterSchedule {
    /// Clones with the capacity for further changes, which a clone of the queue alone would not have.
    fn clone(&self) -> Self {
        let mut waiting = VecDeque::with_capacity(self.waiting.capacity());
        waiting.extend(self.waiting.iter().copied());
        Self { waiting, ..*self }
    }
}

/// Slot of the schedule for a new change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScheduleSlot {
    /// First tick at which the change would be in force.
    pub effective_tick: i64,
    /// Version that it would have.
    pub version: u64,
    /// Set that it would follow.
    pub before: ParameterSettings,
    /// Its index among the waiting changes.
    index: usize,
}

impl ParameterSchedule {
    /// Schedule with a scenario's script. `start` is the pose of the foot, and its first target.
    #[must_use]
    pub fn new(settings: &Settings, start: TipPose) -> Self {
        let first = parameters::parameters(&settings.initial, 1, 0, &start);
        let mut waiting = VecDeque::with_capacity(settings.operator.len() + CAPACITY);
        waiting.extend(settings.operator.iter().copied());
        Self { operator: Operator { current: first, next: first }, next: settings.initial, start, waiting }
    }

    /// Continues behind the sets that another gate has published last, made from `next`. No call waits or allocates.
    pub fn follow(&mut self, operator: &Operator, next: ParameterSettings) {
        if operator.next.version <= self.operator.next.version {
            return;
        }
        (self.operator, self.next) = (*operator, next);
        while self.waiting.front().is_some_and(|change| change.at_tick <= operator.next.effective_tick) {
            self.waiting.pop_front();
        }
    }

    /// Takes a change that another gate has placed, unless it is in force, announced or here already. No call allocates.
    pub fn take_placed(&mut self, change: &OperatorChange) {
        let known = self.waiting.iter().any(|waiting| waiting.at_tick == change.at_tick);
        if change.at_tick > self.operator.next.effective_tick && !known && self.waiting.len() < self.waiting.capacity() {
            let index = self.waiting.iter().take_while(|waiting| waiting.at_tick < change.at_tick).count();
            self.waiting.insert(index, *change);
        }
    }

    /// Parameters in force and announced.
    #[must_use]
    pub fn operator(&self) -> &Operator {
        &self.operator
    }

    /// Announces the next change, if due before the command of `tick` goes out. Returns the parameters to publish.
    pub fn announce(&mut self, tick: i64) -> Option<&Operator> {
        if self.waiting.front()?.at_tick > tick + MIN_SPACING_TICKS {
            return None;
        }
        let change = self.waiting.pop_front()?;
        // Never in the past: another gate's change may be known late.
        let change = OperatorChange { at_tick: change.at_tick.max(tick + 1), ..change };
        let current = *self.operator.at(tick + 1);
        self.next = self.next.with(&change);
        let next = parameters::parameters(&self.next, current.version + 1, change.at_tick, &self.start);
        self.operator = Operator { current, next };
        Some(&self.operator)
    }

    /// Finds the first free slot for a change that arrives before the command of `tick`.
    ///
    /// It is [`MIN_SPACING_TICKS`] ahead, as far from the set announced last, and after closer scripted changes.
    #[must_use]
    pub fn slot(&self, tick: i64) -> ScheduleSlot {
        let earliest = tick.max(self.operator.next.effective_tick) + MIN_SPACING_TICKS;
        let first =
            ScheduleSlot { effective_tick: earliest, version: self.operator.next.version + 1, before: self.next, index: 0 };
        self.waiting.iter().fold(first, |slot, waiting| {
            // The script is in order: all later changes come after this gap.
            if slot.effective_tick + MIN_SPACING_TICKS <= waiting.at_tick {
                return slot;
            }
            ScheduleSlot {
                effective_tick: slot.effective_tick.max(waiting.at_tick + MIN_SPACING_TICKS),
                version: slot.version + 1,
                before: slot.before.with(waiting),
                index: slot.index + 1,
            }
        })
    }

    /// Inserts a change into the first free slot; later scripted changes still apply. Returns its version and the tick
    /// at which it takes effect; `None` if too many are waiting.
    pub fn insert(&mut self, change: &OperatorChange, tick: i64) -> Option<(u64, i64)> {
        if self.waiting.len() >= self.waiting.capacity() {
            return None;
        }
        let slot = self.slot(tick);
        self.waiting.insert(slot.index, OperatorChange { at_tick: slot.effective_tick, ..*change });
        Some((slot.version, slot.effective_tick))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn force(at_tick: i64, force: f64) -> OperatorChange {
        OperatorChange { at_tick, desired_force: Some([0.0, 0.0, force]), ..OperatorChange::default() }
    }

    fn scripted(script: &[(i64, f64)]) -> ParameterSchedule {
        let mut settings = Settings::load("floor", &[]).unwrap();
        settings.initial.desired_force = [0.0, 0.0, 1.0];
        settings.operator = script.iter().map(|(at_tick, f)| force(*at_tick, *f)).collect();
        ParameterSchedule::new(&settings, TipPose { position: [0.1, 0.2, 0.3], rpy: [0.0; 3] })
    }

    #[test]
    fn announce_each_tick_has_its_set_ahead() {
        let mut schedule = scripted(&[(3, 2.0), (8, 3.0), (100, 4.0)]);
        assert_eq!(schedule.operator().at(0).target_position, [0.1, 0.2, 0.3]);
        for tick in -1..150 {
            schedule.announce(tick);
            let at = tick + 1;
            let expected = match at {
                ..3 => 1.0,
                3..8 => 2.0,
                8..100 => 3.0,
                _ => 4.0,
            };
            let set = schedule.operator().at(at);
            assert_eq!(set.desired_force[2], expected, "tick {at}");
            assert_eq!(set.version as f64, expected);
            assert!(set.effective_tick <= at);
        }
    }

    #[test]
    fn insert_online_change_keeps_minimum_spacing() {
        let mut schedule = scripted(&[]);
        schedule.announce(99);
        assert_eq!(schedule.insert(&force(0, 9.0), 100), Some((2, 105)));
        // The next change keeps its distance.
        assert_eq!(schedule.insert(&force(0, 8.0), 101), Some((3, 110)));
        for tick in 100..120 {
            schedule.announce(tick);
            let expected = match tick + 1 {
                ..105 => 1.0,
                105..110 => 9.0,
                _ => 8.0,
            };
            assert_eq!(schedule.operator().at(tick + 1).desired_force[2], expected, "tick {}", tick + 1);
        }
    }

    #[test]
    fn insert_at_any_tick_keeps_script_spacing_and_versions() {
        for tick in 0..60 {
            let mut schedule = scripted(&[(20, 2.0), (25, 3.0), (38, 4.0), (50, 5.0)]);
            let mut promised = None;
            let mut announced = vec![(1, 0)];
            for now in -1..80 {
                if now == tick {
                    // As the gate does: in idle time before the command of `now`.
                    let change = OperatorChange { taper: Some(0.123), ..OperatorChange::default() };
                    promised = schedule.insert(&change, now);
                }
                if let Some(operator) = schedule.announce(now) {
                    announced.push((operator.next.version, operator.next.effective_tick));
                    assert!(operator.next.effective_tick - now <= MIN_SPACING_TICKS, "announced too early");
                    assert!(operator.next.effective_tick > now + 1, "announced too late");
                }
                if let Some((version, effective)) = promised {
                    let changed = schedule.operator().at(now + 1).taper == 0.123;
                    assert_eq!(changed, now + 1 >= effective, "requested at {tick}, now {now}");
                    assert!(effective >= tick + MIN_SPACING_TICKS);
                    assert!(version >= 2);
                }
            }
            assert!(announced.contains(&promised.unwrap()), "requested at {tick}: {promised:?} is not in {announced:?}");
            assert_eq!(announced.len(), 6);
            for pair in announced.windows(2) {
                assert_eq!(pair[1].0, pair[0].0 + 1);
                assert!(pair[1].1 >= pair[0].1 + MIN_SPACING_TICKS, "{announced:?}");
            }
            // Later scripted changes still apply.
            assert_eq!(schedule.operator().at(79).desired_force[2], 5.0);
            assert_eq!(schedule.operator().at(79).taper, 0.123);
        }
    }

    #[test]
    fn slot_reports_set_it_follows() {
        let schedule = scripted(&[(20, 2.0)]);
        assert_eq!(schedule.slot(5).before.desired_force[2], 1.0);
        let behind = schedule.slot(14);
        assert_eq!((behind.effective_tick, behind.version, behind.before.desired_force[2]), (25, 3, 2.0));
    }

    #[test]
    fn follow_at_any_tick_continues_as_the_other_gate() {
        let script = [(3, 2.0), (20, 2.0), (25, 3.0), (60, 5.0)];
        for stop in 0..80 {
            let mut whole = scripted(&script);
            let (mut next, mut placed): (_, Vec<OperatorChange>) = (whole.next, Vec::new());
            let mut resumed: Option<ParameterSchedule> = None;
            for now in -1..100 {
                if [10, 12, 40].contains(&now) {
                    let change = OperatorChange { taper: Some(now as f64 / 1e3), ..OperatorChange::default() };
                    let (_, at_tick) = whole.insert(&change, now).unwrap();
                    placed.push(OperatorChange { at_tick, ..change });
                    if let Some(resumed) = &mut resumed {
                        assert_eq!(resumed.insert(&change, now).map(|(_, tick)| tick), Some(at_tick));
                    }
                }
                whole.announce(now);
                if let Some(resumed) = &mut resumed {
                    resumed.announce(now);
                    assert_eq!(resumed.operator(), whole.operator(), "stopped at {stop}, now {now}");
                }
                next = whole.next;
                if now == stop {
                    let mut other = scripted(&script);
                    other.follow(whole.operator(), next);
                    placed.iter().rev().for_each(|change| other.take_placed(change));
                    // Again, as from a gate that has placed them itself.
                    placed.iter().for_each(|change| other.take_placed(change));
                    resumed = Some(other);
                }
            }
            assert_eq!(resumed.unwrap().next, next);
        }
    }

    #[test]
    fn insert_above_capacity_rejected() {
        let mut schedule = scripted(&[(20, 2.0)]);
        let capacity = schedule.waiting.capacity();
        let taken = (0..capacity + 5).filter(|_| schedule.insert(&force(0, 3.0), 0).is_some()).count();
        assert_eq!((taken, schedule.waiting.capacity()), (capacity - 1, capacity));
    }

    #[test]
    fn clone_keeps_capacity() {
        let schedule = scripted(&[(20, 2.0)]);
        let mut clone = schedule.clone();
        assert_eq!(clone.waiting.capacity(), schedule.waiting.capacity());
        assert_eq!(clone.insert(&force(0, 3.0), 5), Some((2, 10)));
        assert_eq!(schedule.waiting.len(), 1, "the original must not change");
    }
}
