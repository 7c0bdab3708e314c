//! The code as it runs: all rules hold in all states, and what should be possible is.

use crate::stack::Stack;
use hapfic_gate::protocol::WaitPolicy;
use stateright::{Checker, Model};
use std::time::Instant;

/// Fewer states than this would mean that the model does not get anywhere.
const MANY: usize = 100_000;

fn explore(policy: WaitPolicy) {
    let since = Instant::now();
    let stack = Stack { policy, failing: [true; 2], mutation: None, only: None };
    let checker = stack.checker().threads(2).spawn_bfs().join();
    let [states, steps] = [checker.unique_state_count(), checker.state_count()];
    println!("{policy:?}: {states} states, {steps} steps, {:.1} s", since.elapsed().as_secs_f64());
    checker.assert_properties();
    assert!(states > MANY, "{states}");
}

#[test]
fn with_a_deadline_every_rule_holds() {
    explore(WaitPolicy::Deadline);
}

#[test]
fn in_lockstep_every_rule_holds() {
    explore(WaitPolicy::Lockstep);
}
