//! Protocol of gate, primary and standby: a pure transition function, which the gate runs at every tick and
//! `tests/protocol` explores exhaustively.
//!
//! A tick's torque comes from one controller's request, or from none. Controllers keep no state, so either may answer.
//! The protocol decides which to wait for, and how severe a missing answer is.

use crate::severity::{Conditions, severity};
use hapfic_messages::{Process, Severity};

/// Ticks in a row answered by the other controller only, after which it becomes the primary.
pub const PROMOTE_AFTER: u32 = 3;

/// The two slots of controllers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ControllerSlot {
    /// The process named `controller`: the primary at first.
    First,
    /// The process named `standby`.
    Second,
}

impl ControllerSlot {
    /// Both slots.
    pub const BOTH: [Self; 2] = [Self::First, Self::Second];

    /// The other slot.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::First => Self::Second,
            Self::Second => Self::First,
        }
    }

    /// The process in the slot.
    #[must_use]
    pub const fn process(self) -> Process {
        match self {
            Self::First => Process::Controller,
            Self::Second => Process::Standby,
        }
    }
}

/// How the gate waits for requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum WaitPolicy {
    /// Until a deadline: time goes on.
    Deadline,
    /// For every present controller, and for at least one request: the clock waits.
    Lockstep,
}

/// Observation of the gate about the tick that is due, first slot first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Observation {
    /// A valid request has arrived.
    pub valid: [bool; 2],
    /// An invalid request has arrived.
    pub rejected: [bool; 2],
    /// The process is alive and runs ticks.
    pub present: [bool; 2],
    /// The deadline has passed; in lockstep: the time-out of the wait for both has passed.
    pub overdue: bool,
}

impl Observation {
    /// Observation of a single controller that has answered: a stack in one process.
    #[must_use]
    pub const fn alone() -> Self {
        Self { valid: [true, false], rejected: [false; 2], present: [true, false], overdue: false }
    }
}

/// Inputs of the gate at a tick, beside requests.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct GateInputs {
    /// The operator, or a spent restart budget, requests a latched stop.
    pub stop: bool,
    /// The operator re-arms.
    pub rearm: bool,
    /// A process is missing: the stack works on without it.
    pub missing: bool,
}

/// Choice about the tick that is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Choice {
    /// Wait and check again.
    Wait,
    /// Use this slot's request.
    Take(ControllerSlot),
    /// Go without a request: no controller has answered.
    Miss,
}

/// Action of a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TickAction {
    /// Pass the torque of this slot's request.
    Pass(ControllerSlot),
    /// Brake although this slot has answered: the brake has not cleared yet.
    Suppress(ControllerSlot),
    /// Repeat the last torque.
    Repeat,
    /// Brake.
    Brake,
    /// Hold by the drive's own brakes: no torque has been commanded yet.
    Hold,
}

/// State of the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Protocol {
    /// Slot whose request counts if both have answered.
    pub primary: ControllerSlot,
    /// Ticks in a row that only the other slot answered.
    pub misses: u32,
    /// Current severity.
    pub severity: Severity,
    /// Conditions of the severity ladder.
    pub conditions: Conditions,
    /// Whether any request has been used.
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
    /// Chooses what to do now, from an observation. Returns [`Choice::Miss`] only past a deadline.
    #[must_use]
    pub fn choose(&self, seen: &Observation, policy: WaitPolicy) -> Choice {
        let (first, second) = (self.primary, self.primary.other());
        let [valid, rejected, present] = [seen.valid, seen.rejected, seen.present];
        // The gate need not wait for this slot.
        let resolved = |slot: ControllerSlot| {
            let i = slot as usize;
            valid[i] || rejected[i] || !present[i]
        };
        let all = match policy {
            WaitPolicy::Deadline => valid[first as usize] || resolved(first) || seen.overdue,
            WaitPolicy::Lockstep => (resolved(first) && resolved(second)) || seen.overdue,
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

    /// Advances the protocol by a choice. Returns the new state and the tick's action; a choice to wait is no tick.
    #[must_use]
    pub fn step(self, choice: Choice, seen: &Observation, inputs: &GateInputs) -> (Self, Option<TickAction>) {
        let mut next = self;
        match choice {
            Choice::Wait => return (self, None),
            Choice::Take(slot) => {
                next.opened = true;
                next.conditions.missed = 0;
                next.conditions.good = self.conditions.good.saturating_add(1).min(crate::severity::CLEAR_AFTER);
                next.misses = if slot == self.primary { 0 } else { self.misses + 1 };
                let gone = !seen.present[self.primary as usize];
                if next.misses > 0 && (gone || next.misses >= PROMOTE_AFTER) {
                    (next.primary, next.misses) = (slot, 0);
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
            // From here it clears like any brake, after new good ticks.
            next.conditions.good = 0;
        }
        let braked = next.severity >= Severity::Brake;
        let action = match choice {
            Choice::Take(slot) if braked => TickAction::Suppress(slot),
            Choice::Take(slot) => TickAction::Pass(slot),
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
    fn choose_deadline_prefers_primary_until_overdue() {
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
    fn choose_lockstep_waits_for_present_controllers() {
        let protocol = Protocol::default();
        let choose = |seen| protocol.choose(&seen, WaitPolicy::Lockstep);
        assert_eq!(choose(seen([true, false], [true; 2], false)), Choice::Wait);
        assert_eq!(choose(seen([true, true], [true; 2], false)), Choice::Take(ControllerSlot::First));
        assert_eq!(choose(seen([false, true], [false, true], false)), Choice::Take(ControllerSlot::Second));
        assert_eq!(choose(seen([false, true], [true; 2], true)), Choice::Take(ControllerSlot::Second));
        assert_eq!(choose(seen([false; 2], [false; 2], true)), Choice::Wait);
    }

    #[test]
    fn choose_any_observation_takes_only_valid_request() {
        for bits in 0..128_u32 {
            let bit = |i: u32| bits & (1 << i) != 0;
            let seen = Observation {
                valid: [bit(0), bit(1)],
                // A request is valid or rejected, never both.
                rejected: [bit(2) && !bit(0), bit(3) && !bit(1)],
                present: [bit(4), bit(5)],
                overdue: bit(6),
            };
            for primary in ControllerSlot::BOTH {
                let protocol = Protocol { primary, ..Protocol::default() };
                for policy in [WaitPolicy::Deadline, WaitPolicy::Lockstep] {
                    let choice = protocol.choose(&seen, policy);
                    match choice {
                        Choice::Take(slot) => assert!(seen.valid[slot as usize], "{seen:?}"),
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
    fn step_lost_or_late_primary_replaced() {
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
    fn step_after_stop_counts_good_ticks_anew() {
        let alone = Observation::alone();
        let take = Choice::Take(ControllerSlot::First);
        let stop = GateInputs { stop: true, ..GateInputs::default() };
        let (mut protocol, action) = Protocol::default().step(take, &alone, &stop);
        assert_eq!((protocol.severity, action), (Severity::Stopped, Some(TickAction::Suppress(ControllerSlot::First))));
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
    fn step_stop_before_first_torque_stops() {
        let stop = GateInputs { stop: true, ..GateInputs::default() };
        let unanswered = seen([false; 2], [true; 2], true);
        let (after, action) = Protocol::default().step(Choice::Miss, &unanswered, &stop);
        assert_eq!((after.severity, action), (Severity::Stopped, Some(TickAction::Brake)));
        let (_, action) = Protocol::default().step(Choice::Miss, &unanswered, &GateInputs::default());
        assert_eq!(action, Some(TickAction::Hold));
    }
}
