//! Recovery after a re-arm, which is certain: a model without cycles, in which every path ends.

use crate::mutation::{self, Mutation};
use hapfic_gate::protocol::{Choice, ControllerSlot, GateInputs, Observation, Protocol, WaitPolicy};
use hapfic_gate::severity::Conditions;
use hapfic_messages::Severity;
use stateright::{Checker, Model, Property};

/// Ticks within which the severity is nominal again.
const WITHIN: u8 = 20;
const NOMINAL: &str = "re-armed, it becomes nominal";
/// Upper bounds of the initial counts: larger counts behave the same.
const PRIMARY_MISSES: u32 = 2;
const MISSED: u32 = 2;
const GOOD: u32 = 20;

/// Model of the gate after a re-arm. At each tick at least one controller answers.
#[derive(Clone, Copy, Debug)]
struct RecoveryModel {
    mutation: Option<Mutation>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct RecoveryState {
    protocol: Protocol,
    ticks: u8,
}

impl RecoveryModel {
    fn step(&self, protocol: Protocol, valid: [bool; 2], inputs: &GateInputs) -> Protocol {
        let seen = Observation { valid, rejected: [false; 2], present: [true; 2], overdue: true };
        let choice = mutation::choose(self.mutation, &protocol, &seen, WaitPolicy::Deadline);
        assert_ne!(choice, Choice::Wait, "the deadline is over");
        mutation::step(self.mutation, protocol, choice, &seen, inputs).0
    }
}

impl Model for RecoveryModel {
    type State = RecoveryState;
    type Action = [bool; 2];

    /// Every stopped state, re-armed at a tick with or without an answer.
    fn init_states(&self) -> Vec<RecoveryState> {
        let rearm = GateInputs { rearm: true, ..GateInputs::default() };
        let mut states = Vec::new();
        for primary in ControllerSlot::BOTH {
            for (misses, missed, good) in counts() {
                for opened in [false, true] {
                    let conditions = Conditions { missed, good, ..Conditions::default() };
                    let stopped = Protocol { primary, misses, severity: Severity::Stopped, conditions, opened };
                    for valid in [[false; 2], [true; 2]] {
                        let state = RecoveryState { protocol: self.step(stopped, valid, &rearm), ticks: 0 };
                        if !states.contains(&state) {
                            states.push(state);
                        }
                    }
                }
            }
        }
        states
    }

    fn actions(&self, state: &RecoveryState, actions: &mut Vec<[bool; 2]>) {
        if state.ticks < WITHIN {
            actions.extend([[true, false], [false, true], [true, true]]);
        }
    }

    fn next_state(&self, state: &RecoveryState, valid: [bool; 2]) -> Option<RecoveryState> {
        Some(RecoveryState { protocol: self.step(state.protocol, valid, &GateInputs::default()), ticks: state.ticks + 1 })
    }

    fn properties(&self) -> Vec<Property<Self>> {
        vec![Property::eventually(NOMINAL, |_: &Self, state: &RecoveryState| state.protocol.severity == Severity::Nominal)]
    }
}

fn counts() -> impl Iterator<Item = (u32, u32, u32)> {
    (0..=PRIMARY_MISSES)
        .flat_map(|misses| (0..=MISSED).flat_map(move |missed| (0..=GOOD).map(move |good| (misses, missed, good))))
}

#[test]
fn rearm_with_answers_becomes_nominal() {
    let checker = RecoveryModel { mutation: None }.checker().spawn_bfs().join();
    println!("recovery: {} states", checker.unique_state_count());
    assert!(checker.unique_state_count() > usize::from(WITHIN));
    checker.assert_properties();
}

#[test]
fn mutant_rearm_without_clear_found() {
    let checker = RecoveryModel { mutation: Some(Mutation::NeverClears) }.checker().spawn_bfs().join();
    assert!(checker.discovery(NOMINAL).is_some());
}
