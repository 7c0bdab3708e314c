//! Changes of parameters while the foot presses on the floor: the reaction stays near what was and what is asked for.
//!
//! The reaction may lie between its value before a change, F_d before and after it, and what the new limits allow. The
//! margin holds what the law of the axis does not see: the motion along the floor accelerates the leg, which swings the
//! reaction, and the floor answers a step of the force two ticks late and overshoots.

use crate::draw::Draw;
use crate::workers::for_each_seed;
use hapfic_config::{OperatorChange, ParameterSettings, ResetPolicy, Settings};
use hapfic_controller::ForceProfile;
use hapfic_messages::{Parameters, Saturation};
use hapfic_simulation::{Simulation, Snapshot};

const SEQUENCES: u64 = 200;
/// Tick at which the force is settled.
const PRESSED_AT: i64 = 4400;
/// Margin, share of the largest F_d that counts.
const MARGIN_SHARE: f64 = 0.1;
/// Margin, fixed part [N]: short moves reach a_max = 10 m/s^2 along the floor, and a link of the leg has 1 kg.
const MARGIN_N: f64 = 10.0;
/// Weight of the leg on the foot without gravity compensation [N].
const WEIGHT_N: f64 = 12.0;
/// z.
const Z: usize = 2;

/// A stack that presses on the floor with `desired` [N] and its parameter set.
fn pressing(desired: f64, overrides: &[&str]) -> (Simulation, ParameterSettings) {
    let overrides: Vec<String> = overrides.iter().map(|&text| text.to_owned()).collect();
    let mut settings = Settings::load("floor", &overrides).unwrap();
    // Landing, then the desired force; no slide.
    settings.operator.truncate(3);
    settings.operator[2].desired_force = Some([0.0, 0.0, desired]);
    let original = settings.operator.iter().fold(settings.initial, ParameterSettings::with);
    let mut simulation = Simulation::new(&settings).unwrap();
    while simulation.tick() < PRESSED_AT {
        simulation.step().unwrap();
    }
    let force = simulation.snapshot().state.foot_force[Z];
    assert!((force / desired - 1.0).abs() < 0.05, "the foot does not press at the start: {force} N instead of {desired} N");
    (simulation, original)
}

/// Reactions that the limits of a set allow at a posture [N]: the profile's forces with dx within +-x_b, and the weight.
///
/// Where dx is at its bound it does not follow the reference: the damping acts on the reference's velocity, and the
/// convergence of the attractor may release all of the force.
fn allowed(snapshot: &Snapshot, set: &Parameters) -> (f64, f64) {
    let profile = ForceProfile {
        stiffness: set.stiffness[Z],
        max_force: set.max_force[Z],
        position_bound: set.position_bound[Z],
        saturation: Saturation::from_code(set.saturation).unwrap(),
    };
    let distance = snapshot.reference.position[Z] - snapshot.state.foot_position[Z];
    let bound = set.position_bound[Z];
    let at_bound = snapshot.command.request.state.offset[Z].abs() >= (1.0 - 1e-9) * bound;
    let damping = if at_bound { set.damping * set.stiffness[Z].sqrt() * snapshot.reference.velocity[Z].abs() } else { 0.0 };
    let most = if at_bound { 0.0 } else { -profile.force(distance - bound) };
    (-profile.force(distance + bound) + WEIGHT_N + damping, most)
}

/// The range of the reaction under a set [N]: from the force and F_d before to F_d after, as far as the limits allow.
fn range(snapshot: &Snapshot, set: &Parameters, asked: (f64, f64)) -> (f64, f64) {
    let (least, most) = allowed(snapshot, set);
    (asked.0.min(most).max(0.0), asked.1.max(least))
}

/// A change that an operator may make in contact: gains of z, where the foot presses, and targets.
///
/// The gains of x and y stay. There no F_d asks for a force to hold: a change of gains steps the force along the floor, and
/// through the leg's inertia this swings the reaction as well, by as much as the step.
fn random_change(draw: &mut Draw, original: &ParameterSettings) -> OperatorChange {
    let mut change = OperatorChange { mean_speed: Some(0.2), ..OperatorChange::default() };
    for _ in 0..draw.whole(1, 3) {
        match draw.whole(0, 5) {
            0 => change.stiffness = Some(on_z(original.stiffness, draw.log_uniform(0.1, 2.0))),
            1 => change.max_force = Some(on_z(original.max_force, draw.log_uniform(0.1, 1.5))),
            2 => change.position_bound = Some(on_z(original.position_bound, draw.log_uniform(0.1, 2.0))),
            3 => change.reset_policy = Some(draw.one_of(&[ResetPolicy::ContactLoss, ResetPolicy::Never])),
            4 => change.desired_force = Some([0.0, 0.0, draw.within(10.0, 100.0)]),
            _ => change.target_position = original.target_position.map(|t| t.map(|x| x + draw.within(-0.01, 0.01))),
        }
    }
    change
}

/// Gains with those of z multiplied.
fn on_z([x, y, z]: [f64; 3], factor: f64) -> [f64; 3] {
    [x, y, z * factor]
}

/// Largest excess over the range and its margin in a sequence [N], with its place.
fn worst(mut simulation: Simulation, original: &ParameterSettings, seed: u64) -> (f64, String) {
    let mut draw = Draw::new(seed);
    let mut worst = (f64::NEG_INFINITY, String::new());
    let mut set = *simulation.operator().at(simulation.tick());
    let mut log: Vec<String> = Vec::new();
    for _ in 0..draw.whole(2, 5) {
        let change = random_change(&mut draw, original);
        let before = simulation.snapshot().state.foot_force[Z];
        let asked_before = set.desired_force[Z];
        let (_, from) = simulation.change(&change).expect("room for a change");
        log.push(format!("{from}: {change:?}"));
        for _ in 0..draw.whole(20, 400) {
            let snapshot = *simulation.step().unwrap();
            set = *snapshot.operator.at(snapshot.state.tick);
            let asked = [before, asked_before, set.desired_force[Z]];
            let asked = (asked.into_iter().fold(f64::INFINITY, f64::min), asked.into_iter().fold(0.0, f64::max));
            let (low, high) = range(&snapshot, &set, asked);
            let margin = MARGIN_SHARE * asked.1 + MARGIN_N;
            let force = snapshot.state.foot_force[Z];
            let excess = (low - force).max(force - high) - margin;
            if excess > worst.0 {
                let what = format!(
                    "seed {seed}, tick {}: {force:.1} N, range {low:.1} to {high:.1} N, margin {margin:.1} N; changes: {}",
                    snapshot.state.tick,
                    log.join("; ")
                );
                worst = (excess, what);
            }
        }
    }
    worst
}

#[test]
fn contact_random_changes_keep_reaction_in_range() {
    let (start, original) = pressing(50.0, &[]);
    let mut all = for_each_seed(SEQUENCES, |seed| worst(start.clone(), &original, seed));
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    println!("{SEQUENCES} sequences; largest excess over range and margin {:.2} N: {}", all[0].0, all[0].1);
    let failed = all.iter().filter(|(excess, _)| *excess > 0.0).count();
    let first: Vec<&str> = all.iter().take(8).map(|(_, what)| what.as_str()).collect();
    assert_eq!(failed, 0, "{failed} of {SEQUENCES} leave the range:\n{}", first.join("\n"));
}

/// Runs on and returns the reactions [N].
fn reactions(simulation: &mut Simulation, ticks: usize) -> Vec<f64> {
    (0..ticks).map(|_| simulation.step().unwrap().state.foot_force[Z]).collect()
}

#[test]
fn contact_bound_shrinks_below_force_reaction_does_not_rise() {
    let (mut simulation, original) = pressing(50.0, &[]);
    let change = OperatorChange { position_bound: Some([0.0025; 3]), ..OperatorChange::default() };
    simulation.change(&change).expect("room for a change");
    let forces = reactions(&mut simulation, 1000);
    let (least, most) = (forces.iter().copied().fold(f64::INFINITY, f64::min), forces.iter().copied().fold(0.0, f64::max));
    // K0 x_b = 30 N, plus the weight; a hardening profile jumps to F_max = 300 N.
    let left = original.stiffness[Z] * 0.0025;
    println!("x_b = 2.5 mm: {least:.1} to {most:.1} N");
    assert!(most < 50.0 + 3.0, "the reaction rises to {most} N");
    assert!(least > left - 3.0, "the reaction falls to {least} N, the limits allow {left} N");
    let end = forces[forces.len() - 1];
    assert!(end > left - 1.0 && end < left + WEIGHT_N, "{end} N at the end");
}

#[test]
fn contact_soft_gains_hold_force_without_limit_cycle() {
    let (mut simulation, _) = pressing(50.0, &[]);
    let change = OperatorChange { stiffness: Some([1000.0; 3]), ..OperatorChange::default() };
    simulation.change(&change).expect("room for a change");
    reactions(&mut simulation, 1500);
    let forces = reactions(&mut simulation, 1500);
    let mean = forces.iter().sum::<f64>() / forces.len() as f64;
    let rms = (forces.iter().map(|force| (force - mean).powi(2)).sum::<f64>() / forces.len() as f64).sqrt();
    println!("K0 = 1000 N/m: {mean:.2} N, rms {rms:.3} N");
    assert!(rms < 0.03 * mean, "rms {rms} N about {mean} N");
    // K0 x_b = 25 N is all that this stiffness gives, plus the weight.
    assert!(mean > 24.0 && mean < 25.0 + WEIGHT_N, "{mean} N");
}
