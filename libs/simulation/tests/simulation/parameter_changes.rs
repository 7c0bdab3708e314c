//! Rapid random changes of parameters while the foot presses on the floor.
//!
//! The law keeps its bounds under every set. The original set then restores contact and posture.

use crate::draw::Draw;
use crate::workers::for_each_seed;
use hapfic_config::{OperatorChange, ParameterSettings, ResetPolicy, Saturation, Search, Settings};
use hapfic_simulation::{Simulation, Snapshot};

const SEQUENCES: u64 = 1000;
/// Number of the scenario's first changes, in which the foot lands and presses.
const LANDING: usize = 3;
/// Tick at which the foot presses.
const PRESSED_AT: i64 = 4400;
/// F_d of the original set on z [N].
const DESIRED_N: f64 = 50.0;
/// Largest force error of a restored contact, relative to F_d.
const FORCE_TOLERANCE: f64 = 0.05;
/// Time for which force and position must stay restored [ticks].
const HELD_TICKS: i64 = 100;
/// Time limit for the restoration after the original set is in force [ticks].
const TIMEOUT_TICKS: i64 = 3000;

/// Outcome of a sequence.
struct SequenceOutcome {
    /// Time from the original set until force and position are restored [ticks].
    settled_after: i64,
    lost_contact: bool,
    saturated: bool,
}

/// A stack whose foot presses on the floor, and its set of parameters.
fn pressing() -> (Simulation, ParameterSettings) {
    let mut settings = Settings::load("tuning", &[]).unwrap();
    settings.operator.truncate(LANDING);
    let original = settings.operator.iter().fold(settings.initial, ParameterSettings::with);
    assert_eq!(original.desired_force, [0.0, 0.0, DESIRED_N]);
    let mut simulation = Simulation::new(&settings).unwrap();
    while simulation.tick() < PRESSED_AT {
        simulation.step().unwrap();
    }
    let force = simulation.snapshot().state.foot_force[2];
    assert!((force / DESIRED_N - 1.0).abs() < 0.01, "the foot does not press at the start: {force} N");
    (simulation, original)
}

/// A change of one to four parameters, in any combination.
fn random_change(draw: &mut Draw, original: &ParameterSettings) -> OperatorChange {
    let mut change = OperatorChange::default();
    for _ in 0..draw.whole(1, 4) {
        match draw.whole(0, 15) {
            0 => change.stiffness = Some(original.stiffness.map(|k| k * draw.log_uniform(0.05, 3.0))),
            1 => change.max_force = Some(draw.on_each_axis(|draw| draw.log_uniform(1.0, 400.0))),
            2 => change.position_bound = Some(draw.on_each_axis(|draw| draw.log_uniform(1e-3, 0.05))),
            3 => {
                let mut force = draw.on_each_axis(|draw| if draw.one_in(4) { draw.within(-60.0, 60.0) } else { 0.0 });
                force[2] = draw.within(-100.0, 400.0);
                change.desired_force = Some(force);
            }
            4 => {
                let all = [ResetPolicy::ContactLoss, ResetPolicy::AsPrinted, ResetPolicy::Never];
                change.reset_policy = Some(draw.one_of(&all));
            }
            5 => change.saturation = Some(draw.one_of(&[Saturation::Softening, Saturation::Continuous, Saturation::AsPrinted])),
            6 => change.search = Some(draw.one_of(&[Search::Adaptive, Search::Tapered, Search::Sign])),
            7 => change.offset_anti_windup = Some(draw.one_in(2)),
            8 => change.stall_release = Some(draw.one_in(2)),
            9 => change.taper = Some(draw.log_uniform(0.01, 1.0)),
            10 => change.force_hold = Some(draw.one_in(2)),
            11 => change.continuous_reentry = Some(draw.one_in(2)),
            12 => change.damping = Some(draw.within(0.0, 1.0)),
            13 => change.posture_lead = Some(draw.within(0.0, 2e-3)),
            14 => change.mean_speed = Some(draw.log_uniform(0.02, 1.0)),
            _ => change.target_position = original.target_position.map(|t| t.map(|x| x + draw.within(-0.03, 0.03))),
        }
    }
    change
}

/// A change that restores a complete set.
fn restore(original: &ParameterSettings) -> OperatorChange {
    OperatorChange {
        at_tick: 0,
        target_position: original.target_position,
        desired_force: Some(original.desired_force),
        stiffness: Some(original.stiffness),
        max_force: Some(original.max_force),
        position_bound: Some(original.position_bound),
        reset_policy: Some(original.reset_policy),
        saturation: Some(original.saturation),
        search: Some(original.search),
        taper: Some(original.taper),
        search_scale: Some(original.search_scale),
        force_resolution: Some(original.force_resolution),
        gravity_compensation: Some(original.gravity_compensation),
        offset_anti_windup: Some(original.offset_anti_windup),
        stall_release: Some(original.stall_release),
        force_hold: Some(original.force_hold),
        continuous_reentry: Some(original.continuous_reentry),
        damping: Some(original.damping),
        posture_lead: Some(original.posture_lead),
        mean_speed: Some(original.mean_speed),
        max_acceleration: Some(original.max_acceleration),
        // Of a position task: no rotation.
        ..OperatorChange::default()
    }
}

/// Checks the bounds that hold at every tick, under every set.
fn check(snapshot: &Snapshot) -> Result<(), String> {
    let Snapshot { state, command, operator, .. } = snapshot;
    let (tick, request) = (state.tick, &command.request);
    let joints = [&state.joint_position, &state.joint_velocity, &state.joint_torque, &command.torque, &request.torque];
    let axes = [&state.foot_position, &state.foot_velocity, &state.foot_force, &request.force, &request.state.offset];
    let mut numbers = joints.into_iter().flatten().chain(axes.into_iter().flatten());
    if !numbers.all(|number| number.is_finite()) {
        return Err(format!("tick {tick}: not a number in {state:?} or {command:?}"));
    }
    let set = operator.at(tick);
    for axis in 0..3 {
        let (force, offset) = (request.force[axis], request.state.offset[axis]);
        if force.abs() > set.max_force[axis] + 1e-9 {
            return Err(format!("tick {tick}, axis {axis}: F_c = {force} N, F_max = {} N", set.max_force[axis]));
        }
        if offset.abs() > set.position_bound[axis] + 1e-12 {
            return Err(format!("tick {tick}, axis {axis}: dx = {offset} m, x_b = {} m", set.position_bound[axis]));
        }
    }
    Ok(())
}

/// Whether the reference has arrived, the foot follows it, and the force is near F_d.
fn is_restored(snapshot: &Snapshot, original: &ParameterSettings) -> bool {
    let Snapshot { state, reference, .. } = snapshot;
    let target = original.target_position.unwrap();
    let foot_follows = (0..3).all(|axis| {
        let arrived = (reference.position[axis] - target[axis]).abs() < 1e-6;
        arrived && (state.foot_position[axis] - reference.position[axis]).abs() < original.position_bound[axis]
    });
    foot_follows && (state.foot_force[2] - DESIRED_N).abs() < FORCE_TOLERANCE * DESIRED_N
}

fn run(mut simulation: Simulation, original: &ParameterSettings, seed: u64) -> Result<SequenceOutcome, String> {
    let mut draw = Draw::new(seed);
    let mut outcome = SequenceOutcome { settled_after: 0, lost_contact: false, saturated: false };
    let mut step = |simulation: &mut Simulation| -> Result<Snapshot, String> {
        let snapshot = *simulation.step().map_err(|error| error.to_string())?;
        check(&snapshot)?;
        let (force, set) = (snapshot.command.request.force, snapshot.operator.at(snapshot.state.tick));
        outcome.lost_contact |= snapshot.state.foot_force == [0.0; 3];
        outcome.saturated |= (0..3).any(|axis| force[axis].abs() >= 0.999 * set.max_force[axis]);
        Ok(snapshot)
    };
    for _ in 0..draw.whole(3, 6) {
        let change = random_change(&mut draw, original);
        simulation.change(&change).ok_or("no room for a change")?;
        for _ in 0..draw.whole(5, 60) {
            step(&mut simulation)?;
        }
    }
    let (_, from) = simulation.change(&restore(original)).ok_or("no room for the original set")?;
    let mut since = None;
    loop {
        let snapshot = step(&mut simulation)?;
        let tick = snapshot.state.tick;
        since = if tick >= from && is_restored(&snapshot, original) { since.or(Some(tick)) } else { None };
        if let Some(first) = since.filter(|first| tick - first >= HELD_TICKS) {
            outcome.settled_after = first - from;
            return Ok(outcome);
        }
        if tick - from > TIMEOUT_TICKS {
            let (foot, force) = (snapshot.state.foot_position, snapshot.state.foot_force);
            let reference = snapshot.reference.position;
            return Err(format!("not restored after {TIMEOUT_TICKS} ticks: x = {foot:?}, x_d = {reference:?}, F = {force:?}"));
        }
    }
}

#[test]
fn random_changes_keep_bounds_and_original_set_restores_contact() {
    let (start, original) = pressing();
    let results =
        for_each_seed(SEQUENCES, |seed| run(start.clone(), &original, seed).map_err(|what| format!("seed {seed}: {what}")));
    let (done, failed): (Vec<_>, Vec<_>) = results.into_iter().partition(Result::is_ok);
    let done: Vec<SequenceOutcome> = done.into_iter().flatten().collect();
    let failed: Vec<String> = failed.into_iter().filter_map(Result::err).collect();
    let longest = done.iter().map(|outcome| outcome.settled_after).max().unwrap_or(-1);
    let mean = done.iter().map(|outcome| outcome.settled_after).sum::<i64>() as f64 / done.len().max(1) as f64;
    let lost = done.iter().filter(|outcome| outcome.lost_contact).count();
    let saturated = done.iter().filter(|outcome| outcome.saturated).count();
    println!(
        "{SEQUENCES} sequences of changes: {} failed; restored after {mean:.0} ms on average, {longest} ms at most; contact lost in \
         {lost}, F_max reached in {saturated}",
        failed.len()
    );
    assert!(
        failed.is_empty(),
        "{} of {SEQUENCES} failed, the first ones:\n{}",
        failed.len(),
        failed[..failed.len().min(5)].join("\n")
    );
    // Harmless changes would prove nothing.
    assert!(lost > 0 && saturated > 0);
}
