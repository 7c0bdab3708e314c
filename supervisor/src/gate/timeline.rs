//! The operator's parameters over time: announced some ticks before they take effect, so that all change at the same tick.

use hapfic_config::{MIN_SPACING_TICKS, OperatorChange, Parameters, Settings};
use hapfic_controller::parameters;
use hapfic_ipc::message::Operator;
use std::collections::VecDeque;

/// The sets in force and to come.
#[derive(Clone, Debug)]
pub struct Timeline {
    operator: Operator,
    /// What `operator.next` was made from.
    next: Parameters,
    here: [f64; 3],
    waiting: VecDeque<OperatorChange>,
}

impl Timeline {
    /// The scripted operator of a scenario; `here` is where the foot starts, its target until another is given.
    #[must_use]
    pub fn new(settings: &Settings, here: [f64; 3]) -> Self {
        let first = parameters::parameters(&settings.initial, 1, 0, here);
        Self {
            operator: Operator { current: first, next: first },
            next: settings.initial,
            here,
            waiting: settings.operator.iter().copied().collect(),
        }
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
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_tick_of_the_run_knows_its_set_before_it_comes() {
        let mut settings = Settings::load("floor", &[]).unwrap();
        settings.initial.desired_force = [0.0, 0.0, 1.0];
        settings.operator = [(3, 2.0), (8, 3.0), (100, 4.0)]
            .map(|(at_tick, force)| OperatorChange {
                at_tick,
                desired_force: Some([0.0, 0.0, force]),
                ..OperatorChange::default()
            })
            .to_vec();
        let mut timeline = Timeline::new(&settings, [0.1, 0.2, 0.3]);
        assert_eq!(timeline.operator().at(0).target_position, [0.1, 0.2, 0.3]);
        for tick in -1..150 {
            timeline.announce(tick);
            let at = tick + 1;
            let expected = match at {
                ..3 => 1.0,
                3..8 => 2.0,
                8..100 => 3.0,
                _ => 4.0,
            };
            let set = timeline.operator().at(at);
            assert_eq!(set.desired_force[2], expected, "tick {at}");
            assert_eq!(set.version as f64, expected);
            assert!(set.effective_tick <= at);
        }
    }
}
