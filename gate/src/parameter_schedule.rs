//! The operator's parameters over time: announced some ticks before they take effect, so that all change at the same tick.

use hapfic_config::{MIN_SPACING_TICKS, OperatorChange, Parameters, Settings};
use hapfic_controller::parameters;
use hapfic_messages::Operator;
use std::collections::VecDeque;

/// Changes that may be waiting beside those of the script. The room is there from the start: the gate does not allocate.
const CAPACITY: usize = 16;

/// The sets in force and to come.
#[derive(Debug)]
pub struct ParameterSchedule {
    operator: Operator,
    /// What `operator.next` was made from.
    next: Parameters,
    here: [f64; 3],
    waiting: VecDeque<OperatorChange>,
}

impl Clone for ParameterSchedule {
    /// With the room for further changes, which a clone of the queue alone would not have.
    fn clone(&self) -> Self {
        let mut waiting = VecDeque::with_capacity(self.waiting.capacity());
        waiting.extend(self.waiting.iter().copied());
        Self { waiting, ..*self }
    }
}

/// Where a change that comes now would go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScheduleSlot {
    /// First tick at which it would be in force.
    pub effective_tick: i64,
    /// The version it would have.
    pub version: u64,
    /// The set it would follow.
    pub before: Parameters,
    /// Its place among those that wait.
    index: usize,
}

impl ParameterSchedule {
    /// The scripted operator of a scenario; `here` is where the foot starts, its target until another is given.
    #[must_use]
    pub fn new(settings: &Settings, here: [f64; 3]) -> Self {
        let first = parameters::parameters(&settings.initial, 1, 0, here);
        let mut waiting = VecDeque::with_capacity(settings.operator.len() + CAPACITY);
        waiting.extend(settings.operator.iter().copied());
        Self { operator: Operator { current: first, next: first }, next: settings.initial, here, waiting }
    }

    /// What is in force and what is announced.
    #[must_use]
    pub fn operator(&self) -> &Operator {
        &self.operator
    }

    /// To be called before the command of `tick` goes out. Returns what to publish, if something new is announced.
    pub fn announce(&mut self, tick: i64) -> Option<&Operator> {
        if self.waiting.front()?.at_tick > tick + MIN_SPACING_TICKS {
            return None;
        }
        let change = self.waiting.pop_front()?;
        let current = *self.operator.at(tick + 1);
        self.next = self.next.with(&change);
        let next = parameters::parameters(&self.next, current.version + 1, change.at_tick, self.here);
        self.operator = Operator { current, next };
        Some(&self.operator)
    }

    /// The first free place for a change that comes before the command of `tick` is due: [`MIN_SPACING_TICKS`] ahead, as far from
    /// the set announced last, and behind what is scripted closer than that.
    #[must_use]
    pub fn slot(&self, tick: i64) -> ScheduleSlot {
        let earliest = tick.max(self.operator.next.effective_tick) + MIN_SPACING_TICKS;
        let first =
            ScheduleSlot { effective_tick: earliest, version: self.operator.next.version + 1, before: self.next, index: 0 };
        self.waiting.iter().fold(first, |slot, waiting| {
            // The script is in order: what comes after a gap comes after it all.
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

    /// Puts a change into the first free place; later ones of the script still change what they name. Returns its version and the
    /// tick at which it takes effect; `None` if too many are waiting.
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
        ParameterSchedule::new(&settings, [0.1, 0.2, 0.3])
    }

    #[test]
    fn every_tick_of_the_run_knows_its_set_before_it_comes() {
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
    fn a_change_takes_effect_as_far_ahead_as_the_script_is_announced() {
        let mut schedule = scripted(&[]);
        schedule.announce(99);
        assert_eq!(schedule.insert(&force(0, 9.0), 100), Some((2, 105)));
        // The next one keeps its distance.
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
    fn wherever_a_change_falls_into_the_script_all_keep_their_distance_and_versions_count_up() {
        for tick in 0..60 {
            let mut schedule = scripted(&[(20, 2.0), (25, 3.0), (38, 4.0), (50, 5.0)]);
            let mut promised = None;
            let mut announced = vec![(1, 0)];
            for now in -1..80 {
                if now == tick {
                    // As the gate does: in the slack before the command of `now`.
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
                    assert_eq!(changed, now + 1 >= effective, "asked at {tick}, now {now}");
                    assert!(effective >= tick + MIN_SPACING_TICKS);
                    assert!(version >= 2);
                }
            }
            assert!(announced.contains(&promised.unwrap()), "asked at {tick}: {promised:?} is not in {announced:?}");
            assert_eq!(announced.len(), 6);
            for pair in announced.windows(2) {
                assert_eq!(pair[1].0, pair[0].0 + 1);
                assert!(pair[1].1 >= pair[0].1 + MIN_SPACING_TICKS, "{announced:?}");
            }
            // The script goes on on top of it.
            assert_eq!(schedule.operator().at(79).desired_force[2], 5.0);
            assert_eq!(schedule.operator().at(79).taper, 0.123);
        }
    }

    #[test]
    fn a_slot_tells_the_set_it_follows() {
        let schedule = scripted(&[(20, 2.0)]);
        assert_eq!(schedule.slot(5).before.desired_force[2], 1.0);
        let behind = schedule.slot(14);
        assert_eq!((behind.effective_tick, behind.version, behind.before.desired_force[2]), (25, 3, 2.0));
    }

    #[test]
    fn there_is_room_for_so_many_and_no_more() {
        let mut schedule = scripted(&[(20, 2.0)]);
        let room = schedule.waiting.capacity();
        let taken = (0..room + 5).filter(|_| schedule.insert(&force(0, 3.0), 0).is_some()).count();
        assert_eq!((taken, schedule.waiting.capacity()), (room - 1, room));
    }

    #[test]
    fn a_clone_has_the_same_room() {
        let schedule = scripted(&[(20, 2.0)]);
        let mut clone = schedule.clone();
        assert_eq!(clone.waiting.capacity(), schedule.waiting.capacity());
        assert_eq!(clone.insert(&force(0, 3.0), 5), Some((2, 10)));
        assert_eq!(schedule.waiting.len(), 1, "the original must not change");
    }
}
