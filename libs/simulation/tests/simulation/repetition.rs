//! Determinism: two equal stacks, or a stack and its clone, compute the same bits, objects included.

use crate::bits::bits;
use crate::draw::Draw;
use crate::script;
use hapfic_config::OperatorChange;
use hapfic_simulation::Simulation;

/// Duration with several targets [ticks].
const TICKS: u64 = 4000;

fn expect_same(a: &mut Simulation, b: &mut Simulation, ticks: u64) {
    for _ in 0..ticks {
        let (a, b) = (a.step().unwrap(), b.step().unwrap());
        assert_eq!(a.state, b.state);
        assert_eq!(a.reference, b.reference);
        assert_eq!(a.command, b.command);
        assert!(bits(a) == bits(b), "tick {}: equal numbers with different bits", a.state.tick);
    }
}

#[test]
fn stack_same_settings_give_same_bits() {
    for (scenario, seed) in [("box", 11), ("ball", 12)] {
        let settings = script::random(scenario, seed, TICKS);
        let (mut a, mut b) = (Simulation::new(&settings).unwrap(), Simulation::new(&settings).unwrap());
        let start = a.snapshot().state.objects[0];
        expect_same(&mut a, &mut b, TICKS);
        assert_ne!(a.snapshot().state.objects[0], start, "{scenario}: the object has not moved");
    }
}

#[test]
fn stack_other_seed_gives_other_bits() {
    let [a, b] = [1, 2].map(|seed| {
        let mut simulation = Simulation::new(&script::random("box", seed, TICKS)).unwrap();
        for _ in 0..TICKS {
            simulation.step().unwrap();
        }
        bits(simulation.snapshot())
    });
    assert_ne!(a, b);
}

#[test]
fn stack_clone_matches_original_and_accepts_changes() {
    let settings = script::random("ball", 13, TICKS);
    let mut original = Simulation::new(&settings).unwrap();
    for _ in 0..TICKS / 2 {
        original.step().unwrap();
    }
    let mut clone = original.clone();
    expect_same(&mut original, &mut clone, TICKS / 4);
    // A clone without pending changes has capacity for changes too.
    let last = settings.operator.last().unwrap().target_position.unwrap();
    while original.snapshot().operator.next.target_position != last {
        assert!(original.tick() < TICKS as i64, "the script does not end");
        original.step().unwrap();
    }
    let mut clone = original.clone();
    let change = OperatorChange { mean_speed: Some(Draw::new(1).within(0.1, 0.2)), ..OperatorChange::default() };
    let taken = clone.change(&change);
    assert!(taken.is_some(), "the clone rejects the change");
    assert_eq!(original.change(&change), taken);
    expect_same(&mut original, &mut clone, 100);
}
