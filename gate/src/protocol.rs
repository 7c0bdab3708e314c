//! The protocol of gate, primary and standby: one pure transition function, which the gate runs at every tick and which
//! `tests/protocol` explores exhaustively.
//!
//! A tick's torque comes from one controller's request or from none. Controllers keep no state, so either may answer: what has to
//! be decided is only for whom to wait, and how bad it is when nobody comes.

use crate::severity::{Conditions, severity};
use hapfic_messages::{Process, Severity};

/// Ticks in a row in which only the other controller answered, after which that one becomes the primary.
pub const PROMOTE_AFTER: u32 = 3;

/// The two places of controllers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ControllerSlot {
    /// The process named `controller`: the primary at first.
    First,
    /// The process named `standby`.
    Second,
}

impl ControllerSlot {
    /// Both.
    pub const BOTH: [Self; 2] = [Self::First, Self::Second];

    /// The other one.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::First => Self::Second,
            Self::Second => Self::First,
        }
    }

    /// The process in it.
    #[must_use]
    pub const fn process(self) -> Process {
        match self {
            Self::First => Process::Controller,
            Self::Second => Process::Standby,
        }
    }
}

/// How the gate waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum WaitPolicy {
    /// Until a deadline: time does not stand still.
    Deadline,
    /// For every controller that is there, and for one in any case: the clock waits.
    Lockstep,
}

/// What the gate sees when it looks, first place first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Observation {
    /// A request for the tick that is due has come and may be used.
    pub valid: [bool; 2],
    /// One has come that may not.
    pub rejected: [bool; 2],
    /// The process lives and does ticks.
    pub present: [bool; 2],
    /// The deadline has passed; in lockstep: it is no use waiting for both any longer.
    pub overdue: bool,
}

impl Observation {
    /// One controller, which has answered: a stack in one process.
    #[must_use]
    pub const fn alone() -> Self {
        Self { valid: [true, false], rejected: [false; 2], present: [true, false], overdue: false }
    }
}

/// What others want of the gate at a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct GateInputs {
    /// The operator, or a spent restart budget, asks for a latched stop.
    pub stop: bool,
    /// The operator re-arms.
    pub rearm: bool,
    /// A process is missing: the stack works on without it.
    pub missing: bool,
}

/// What to do now about the tick that is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Choice {
    /// Wait and look again.
    Wait,
    /// Use this place's request.
    Take(ControllerSlot),
    /// Go without: nobody has answered.
    Miss,
}

/// What becomes of a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TickAction {
    /// The torque of this place's request.
    Pass(ControllerSlot),
    /// The drive brakes although this place has answered: the brake has not cleared yet.
    Withhold(ControllerSlot),
    /// The last torque once more.
    Repeat,
    /// The drive brakes.
    Brake,
    /// Nothing has ever been commanded: the drive's own brakes hold.
    Hold,
}

/// The gate's memory, as far as the protocol goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Protocol {
    /// Whose request counts if both have answered.
    pub primary: ControllerSlot,
    /// Ticks in a row in which only the other answered.
    pub misses: u32,
    /// How bad it is.
    pub severity: Severity,
    /// What the ladder looks at.
    pub conditions: Conditions,
    /// Whether any request was ever used.
    pub opened: bool,
}

impl Default for Protocol {
    fn default() -> Self {
        Self {
            primary: ControllerSlot::First,
            misses: 0,
            severity: Severity::Nominal,
            conditions: Conditions::default(),
            opened: false,
        }
    }
}

impl Protocol {
    /// What to do now, from what is seen. Says [`Choice::Miss`] only past a deadline.
    #[must_use]
    pub fn choose(&self, seen: &Observation, policy: WaitPolicy) -> Choice {
        let (first, second) = (self.primary, self.primary.other());
        let [valid, rejected, present] = [seen.valid, seen.rejected, seen.present];
        // Nothing more is to be expected from this place.
        let settled = |place: ControllerSlot| {
            let i = place as usize;
            valid[i] || rejected[i] || !present[i]
        };
        let all = match policy {
            WaitPolicy::Deadline => valid[first as usize] || settled(first) || seen.overdue,
            WaitPolicy::Lockstep => (settled(first) && settled(second)) || seen.overdue,
        };
        if all && valid[first as usize] {
            Choice::Take(first)
        } else if all && valid[second as usize] {
            Choice::Take(second)
        } else if seen.overdue && policy == WaitPolicy::Deadline {
            Choice::Miss
        } else {
            Choice::Wait
        }
    }

    /// The memory after a tick, and what becomes of the tick, from what was chosen. A choice to wait is no tick.
    #[must_use]
    pub fn step(self, choice: Choice, seen: &Observation, inputs: &GateInputs) -> (Self, Option<TickAction>) {
        let mut next = self;
        match choice {
            Choice::Wait => return (self, None),
            Choice::Take(place) => {
                next.opened = true;
                next.conditions.missed = 0;
                next.conditions.good = self.conditions.good.saturating_add(1).min(crate::severity::CLEAR_AFTER);
                next.misses = if place == self.primary { 0 } else { self.misses + 1 };
                let gone = !seen.present[self.primary as usize];
                if next.misses > 0 && (gone || next.misses >= PROMOTE_AFTER) {
                    (next.primary, next.misses) = (place, 0);
                }
            }
            Choice::Miss => {
                next.conditions.missed = (self.conditions.missed + 1).min(crate::severity::BRAKE_AT);
                next.conditions.good = 0;
                if !self.opened {
                    next.conditions.missed = 0;
                }
            }
        }
        next.conditions = Conditions { stop: inputs.stop, rearm: inputs.rearm, missing: inputs.missing, ..next.conditions };
        next.severity = severity(self.severity, &next.conditions);
        if self.severity == Severity::Stopped && next.severity < Severity::Stopped {
            // From here it clears like any brake: with good ticks of its own.
            next.conditions.good = 0;
        }
        let braked = next.severity >= Severity::Brake;
        let action = match choice {
            Choice::Take(place) if braked => TickAction::Withhold(place),
            Choice::Take(place) => TickAction::Pass(place),
            _ if !self.opened && next.severity < Severity::Stopped => TickAction::Hold,
            _ if braked => TickAction::Brake,
            _ => TickAction::Repeat,
        };
        (next, Some(action))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(valid: [bool; 2], present: [bool; 2], overdue: bool) -> Observation {
        Observation { valid, present, overdue, rejected: [false; 2] }
    }

    #[test]
    fn with_a_deadline_the_primary_is_taken_at_once_and_the_other_only_if_it_does_not_come() {
        let protocol = Protocol::default();
        let choose = |seen| protocol.choose(&seen, WaitPolicy::Deadline);
        let both = [true; 2];
        assert_eq!(choose(seen([true, false], both, false)), Choice::Take(ControllerSlot::First));
        assert_eq!(choose(seen([false, true], both, false)), Choice::Wait);
        assert_eq!(choose(seen([false, true], both, true)), Choice::Take(ControllerSlot::Second));
        assert_eq!(choose(seen([false, true], [false, true], false)), Choice::Take(ControllerSlot::Second));
        assert_eq!(choose(seen([false, false], [false, true], false)), Choice::Wait);
        assert_eq!(choose(seen([false, false], both, true)), Choice::Miss);
        let rejected = Observation { rejected: [true, false], ..seen([false, true], both, false) };
        assert_eq!(choose(rejected), Choice::Take(ControllerSlot::Second));
    }

    #[test]
    fn lockstep_waits_for_all_that_are_there_and_never_goes_without() {
        let protocol = Protocol::default();
        let choose = |seen| protocol.choose(&seen, WaitPolicy::Lockstep);
        assert_eq!(choose(seen([true, false], [true; 2], false)), Choice::Wait);
        assert_eq!(choose(seen([true, true], [true; 2], false)), Choice::Take(ControllerSlot::First));
        assert_eq!(choose(seen([false, true], [false, true], false)), Choice::Take(ControllerSlot::Second));
        assert_eq!(choose(seen([false, true], [true; 2], true)), Choice::Take(ControllerSlot::Second));
        assert_eq!(choose(seen([false; 2], [false; 2], true)), Choice::Wait);
    }

    #[test]
    fn whatever_is_seen_it_decides_when_it_must_and_takes_only_what_is_valid() {
        for bits in 0..128_u32 {
            let bit = |i: u32| bits & (1 << i) != 0;
            let seen = Observation {
                valid: [bit(0), bit(1)],
                // A request is one or the other.
                rejected: [bit(2) && !bit(0), bit(3) && !bit(1)],
                present: [bit(4), bit(5)],
                overdue: bit(6),
            };
            for primary in ControllerSlot::BOTH {
                let protocol = Protocol { primary, ..Protocol::default() };
                for policy in [WaitPolicy::Deadline, WaitPolicy::Lockstep] {
                    let choice = protocol.choose(&seen, policy);
                    match choice {
                        Choice::Take(place) => assert!(seen.valid[place as usize], "{seen:?}"),
                        Choice::Miss => assert!(policy == WaitPolicy::Deadline && seen.overdue && seen.valid == [false; 2]),
                        Choice::Wait => assert!(!seen.overdue || (policy == WaitPolicy::Lockstep && seen.valid == [false; 2])),
                    }
                    let all_answered = (0..2).all(|i| seen.valid[i] || seen.rejected[i] || !seen.present[i]);
                    if all_answered && seen.valid != [false; 2] {
                        assert_ne!(choice, Choice::Wait, "{seen:?} {policy:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_primary_that_is_gone_is_replaced_at_once_and_one_that_is_late_after_three_ticks() {
        let inputs = GateInputs::default();
        let gone = seen([false, true], [false, true], false);
        let (after, action) = Protocol::default().step(Choice::Take(ControllerSlot::Second), &gone, &inputs);
        assert_eq!(
            (after.primary, after.misses, action),
            (ControllerSlot::Second, 0, Some(TickAction::Pass(ControllerSlot::Second)))
        );
        let late = seen([false, true], [true; 2], true);
        let mut protocol = Protocol::default();
        for tick in 1..=PROMOTE_AFTER {
            (protocol, _) = protocol.step(Choice::Take(ControllerSlot::Second), &late, &inputs);
            assert_eq!(protocol.primary == ControllerSlot::Second, tick == PROMOTE_AFTER, "tick {tick}");
        }
    }

    #[test]
    fn after_a_stop_the_good_ticks_count_anew() {
        let alone = Observation::alone();
        let take = Choice::Take(ControllerSlot::First);
        let stop = GateInputs { stop: true, ..GateInputs::default() };
        let (mut protocol, action) = Protocol::default().step(take, &alone, &stop);
        assert_eq!((protocol.severity, action), (Severity::Stopped, Some(TickAction::Withhold(ControllerSlot::First))));
        for _ in 0..100 {
            (protocol, _) = protocol.step(take, &alone, &GateInputs::default());
        }
        assert_eq!(protocol.severity, Severity::Stopped, "latched");
        (protocol, _) = protocol.step(take, &alone, &GateInputs { rearm: true, ..GateInputs::default() });
        let mut ticks = 0;
        while protocol.severity >= Severity::Brake {
            (protocol, _) = protocol.step(take, &alone, &GateInputs::default());
            ticks += 1;
        }
        assert_eq!(ticks, crate::severity::CLEAR_AFTER);
    }

    #[test]
    fn a_stop_before_the_first_torque_is_a_stop() {
        let stop = GateInputs { stop: true, ..GateInputs::default() };
        let nobody = seen([false; 2], [true; 2], true);
        let (after, action) = Protocol::default().step(Choice::Miss, &nobody, &stop);
        assert_eq!((after.severity, action), (Severity::Stopped, Some(TickAction::Brake)));
        let (_, action) = Protocol::default().step(Choice::Miss, &nobody, &GateInputs::default());
        assert_eq!(action, Some(TickAction::Hold));
    }
}
