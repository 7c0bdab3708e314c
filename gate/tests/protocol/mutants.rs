//! Every rule can fail: for each there is a mutant that breaks it, and the checker finds it.
//!
//! In these models only the first place fails: enough for each mutant, and for the code itself, which has to pass as a control.

use crate::mutation::Mutation;
use crate::rules::Rule;
use crate::stack::{self, Stack};
use hapfic_gate::protocol::WaitPolicy;
use stateright::{Checker, Model};

const FAILING: [bool; 2] = [true, false];

/// Whether the checker finds anything under a name: a counterexample of a rule, an example of what should be possible.
fn finds(policy: WaitPolicy, mutation: Mutation, name: &'static str) -> bool {
    let model = Stack { policy, failing: FAILING, mutation: Some(mutation), only: Some(name) };
    let checker = model.checker().threads(2).spawn_bfs().join();
    let found = checker.discovery(name).is_some();
    assert!(found || checker.is_done(), "{mutation:?}: all states were visited");
    found
}

/// The mutant breaks the rule.
fn caught(mutation: Mutation, rule: Rule) {
    assert!(finds(WaitPolicy::Deadline, mutation, rule.name()), "{mutation:?} passes for \"{}\"", rule.name());
}

/// With the mutant it is not possible any more.
fn lost(mutation: Mutation, name: &'static str) {
    assert!(!finds(WaitPolicy::Deadline, mutation, name), "{mutation:?}: still, {name}");
}

#[test]
fn without_a_mutation_there_is_nothing_to_find() {
    for policy in [WaitPolicy::Deadline, WaitPolicy::Lockstep] {
        let model = Stack { policy, failing: FAILING, mutation: None, only: None };
        model.checker().threads(2).spawn_bfs().join().assert_properties();
    }
}

#[test]
fn torque_of_a_place_that_has_not_answered_is_found() {
    caught(Mutation::TakesUnasked, Rule::OneSource);
}

#[test]
fn a_standby_that_is_not_asked_is_found() {
    caught(Mutation::IgnoresStandby, Rule::Torque);
}

#[test]
fn a_deadline_in_lockstep_is_found() {
    assert!(finds(WaitPolicy::Lockstep, Mutation::LockstepWithDeadline, Rule::NeverWithout.name()));
}

#[test]
fn a_brake_at_the_first_miss_is_found() {
    caught(Mutation::BrakesAtOnce, Rule::BrakeCause);
}

#[test]
fn repeating_for_ever_is_found() {
    caught(Mutation::NeverBrakes, Rule::BrakeAtSecond);
}

#[test]
fn restarting_without_end_is_found() {
    caught(Mutation::NoBudget, Rule::Budget);
}

#[test]
fn a_restart_after_the_budget_is_spent_is_found() {
    caught(Mutation::RisesAgain, Rule::Spent);
}

#[test]
fn a_budget_spent_in_silence_is_found() {
    caught(Mutation::SpentInSilence, Rule::SpentStops);
}

#[test]
fn a_stop_left_by_itself_is_found() {
    caught(Mutation::Unlatched, Rule::Latch);
}

#[test]
fn a_primary_that_is_kept_when_gone_is_found() {
    caught(Mutation::NeverPromotes, Rule::HandOver);
}

#[test]
fn a_hasty_promotion_is_found() {
    caught(Mutation::PromotesAtOnce, Rule::PromotionCause);
}

#[test]
fn a_brake_cleared_too_early_is_found() {
    caught(Mutation::ClearsAtOnce, Rule::ClearCause);
}

#[test]
fn a_brake_that_stays_after_twenty_good_ticks_is_found() {
    caught(Mutation::NeverClears, Rule::Clears);
}

#[test]
fn a_life_that_goes_another_way_than_the_model_is_found() {
    caught(Mutation::LifeDeafToRearm, Rule::Ages);
}

#[test]
fn a_stop_that_cannot_be_reached_is_found() {
    lost(Mutation::DeafToStop, stack::STOPPED);
}

#[test]
fn a_stop_that_cannot_be_left_is_found() {
    lost(Mutation::DeafToRearm, stack::LEFT);
}

#[test]
fn a_brake_without_an_end_is_found() {
    lost(Mutation::NeverClears, stack::BACK);
}

#[test]
fn a_primary_for_ever_is_found() {
    lost(Mutation::NeverPromotes, stack::PROMOTED);
}

#[test]
fn a_budget_that_cannot_be_spent_is_found() {
    lost(Mutation::NoBudget, stack::SPENT);
}
