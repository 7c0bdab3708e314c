//! Mutants: each breaks a rule, and the checker has to find it.
//!
//! In these models only the first slot fails: enough for each mutant, and for the code itself, the control.

use crate::mutation::Mutation;
use crate::rules::Rule;
use crate::stack::{self, StackModel};
use hapfic_gate::protocol::WaitPolicy;
use stateright::{Checker, Model};

const FAILING: [bool; 2] = [true, false];

/// Whether the checker finds a property's counterexample (of a rule) or example (of what should be possible).
fn finds(policy: WaitPolicy, mutation: Mutation, name: &'static str) -> bool {
    let model = StackModel { policy, failing: FAILING, mutation: Some(mutation), only: Some(name) };
    let checker = model.checker().threads(2).spawn_bfs().join();
    let found = checker.discovery(name).is_some();
    assert!(found || checker.is_done(), "{mutation:?}: all states were visited");
    found
}

/// Asserts that the mutant breaks the rule.
fn assert_breaks(mutation: Mutation, rule: Rule) {
    assert!(finds(WaitPolicy::Deadline, mutation, rule.name()), "{mutation:?} passes for \"{}\"", rule.name());
}

/// Asserts that the mutant prevents what should be possible.
fn assert_prevents(mutation: Mutation, name: &'static str) {
    assert!(!finds(WaitPolicy::Deadline, mutation, name), "{mutation:?}: {name}, expected never");
}

#[test]
fn checker_without_mutation_finds_nothing() {
    for policy in [WaitPolicy::Deadline, WaitPolicy::Lockstep] {
        let model = StackModel { policy, failing: FAILING, mutation: None, only: None };
        model.checker().threads(2).spawn_bfs().join().assert_properties();
    }
}

#[test]
fn mutant_torque_without_answer_found() {
    assert_breaks(Mutation::TakesUnanswered, Rule::OneSource);
}

#[test]
fn mutant_ignored_standby_found() {
    assert_breaks(Mutation::IgnoresStandby, Rule::Torque);
}

#[test]
fn mutant_deadline_in_lockstep_found() {
    assert!(finds(WaitPolicy::Lockstep, Mutation::LockstepWithDeadline, Rule::NeverWithout.name()));
}

#[test]
fn mutant_brake_at_first_miss_found() {
    assert_breaks(Mutation::BrakesAtFirstMiss, Rule::BrakeCause);
}

#[test]
fn mutant_endless_repeat_found() {
    assert_breaks(Mutation::NeverBrakes, Rule::BrakeAtSecond);
}

#[test]
fn mutant_endless_restart_found() {
    assert_breaks(Mutation::NoBudget, Rule::Budget);
}

#[test]
fn mutant_restart_after_spent_budget_found() {
    assert_breaks(Mutation::RestartsWhenSpent, Rule::Spent);
}

#[test]
fn mutant_spent_budget_without_stop_found() {
    assert_breaks(Mutation::SpentWithoutStop, Rule::SpentStops);
}

#[test]
fn mutant_unlatched_stop_found() {
    assert_breaks(Mutation::Unlatched, Rule::Latch);
}

#[test]
fn mutant_kept_lost_primary_found() {
    assert_breaks(Mutation::NeverPromotes, Rule::HandOver);
}

#[test]
fn mutant_early_promotion_found() {
    assert_breaks(Mutation::PromotesAtFirstMiss, Rule::PromotionCause);
}

#[test]
fn mutant_early_clear_found() {
    assert_breaks(Mutation::ClearsAtFirstGoodTick, Rule::ClearCause);
}

#[test]
fn mutant_late_clear_found() {
    assert_breaks(Mutation::NeverClears, Rule::Clears);
}

#[test]
fn mutant_restart_unlike_model_found() {
    assert_breaks(Mutation::RestartIgnoresRearm, Rule::Ages);
}

#[test]
fn mutant_unreachable_stop_found() {
    assert_prevents(Mutation::IgnoresStop, stack::STOPPED);
}

#[test]
fn mutant_endless_stop_found() {
    assert_prevents(Mutation::IgnoresRearm, stack::LEFT);
}

#[test]
fn mutant_endless_brake_found() {
    assert_prevents(Mutation::NeverClears, stack::BACK);
}

#[test]
fn mutant_fixed_primary_found() {
    assert_prevents(Mutation::NeverPromotes, stack::PROMOTED);
}

#[test]
fn mutant_unlimited_budget_found() {
    assert_prevents(Mutation::NoBudget, stack::SPENT);
}
