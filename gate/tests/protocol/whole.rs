//! The code without mutation: all rules hold in all states, and what should be possible is.

use crate::stack::StackModel;
use hapfic_gate::protocol::WaitPolicy;
use stateright::{Checker, Model};
use std::time::Instant;

/// Lower bound of the number of states: fewer would mean that the model is stuck.
const MANY: usize = 100_000;

fn explore(policy: WaitPolicy) {
    let since = Instant::now();
    let stack = StackModel { policy, failing: [true; 2], mutation: None, only: None };
    let checker = stack.checker().threads(2).spawn_bfs().join();
    let [states, steps] = [checker.unique_state_count(), checker.state_count()];
    println!("{policy:?}: {states} states, {steps} steps, {:.1} s", since.elapsed().as_secs_f64());
    checker.assert_properties();
    assert!(states > MANY, "{states}");
}

#[test]
fn deadline_all_states_keep_rules() {
    explore(WaitPolicy::Deadline);
}

#[test]
fn lockstep_all_states_keep_rules() {
    explore(WaitPolicy::Lockstep);
}
