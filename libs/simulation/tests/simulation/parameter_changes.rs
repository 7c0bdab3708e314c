//! Changes of parameters one on the heels of the other while the foot presses on the floor: whatever they are, the law keeps
//! its bounds, and sane ones bring contact and posture back.

use crate::draw::Draw;
use crate::workers::for_each_seed;
use hapfic_config::{OperatorChange, Parameters, ResetPolicy, Saturation, Search, Settings};
use hapfic_simulation::{Simulation, Snapshot};

const SEQUENCES: u64 = 1000;
/// Entries of the scenario that bring the foot down and let it press.
const LANDING: usize = 3;
/// By then it presses.
const PRESSED_AT: i64 = 4400;
/// F_d of the sane set on z, N.
const DESIRED_N: f64 = 50.0;
/// Share of F_d that counts as met.
const MET: f64 = 0.05;
/// So long everything has to stay within its band, ticks.
const HELD_TICKS: i64 = 100;
/// By then it has to be there for good, ticks after the sane set is in force.
const PATIENCE_TICKS: i64 = 3000;

/// What a sequence did.
struct Outcome {
    /// Ticks from the sane set on until force and position stayed where they should be.
    settled_after: i64,
    lost_contact: bool,
    saturated: bool,
}

/// A stack whose foot has landed and presses, and the set it does so under.
fn pressing() -> (Simulation, Parameters) {
    let mut settings = Settings::load("tuning", &[]).unwrap();
    settings.operator.truncate(LANDING);
    let sane = settings.operator.iter().fold(settings.initial, Parameters::with);
    assert_eq!(sane.desired_force, [0.0, 0.0, DESIRED_N]);
    let mut simulation = Simulation::new(&settings).unwrap();
    while simulation.tick() < PRESSED_AT {
        simulation.step().unwrap();
    }
    let force = simulation.snapshot().state.foot_force[2];
    assert!((force / DESIRED_N - 1.0).abs() < 0.01, "the foot does not press at the start: {force} N");
    (simulation, sane)
}

/// A change of one to four parameters, whether they fit together or not.
fn any_change(draw: &mut Draw, sane: &Parameters) -> OperatorChange {
    let mut change = OperatorChange::default();
    for _ in 0..draw.whole(1, 4) {
        match draw.whole(0, 11) {
            0 => change.stiffness = Some(sane.stiffness.map(|k| k * draw.of_any_size(0.05, 3.0))),
            1 => change.max_force = Some(draw.on_each_axis(|draw| draw.of_any_size(1.0, 400.0))),
            2 => change.position_bound = Some(draw.on_each_axis(|draw| draw.of_any_size(1e-3, 0.05))),
            3 => {
                let mut force = draw.on_each_axis(|draw| if draw.one_in(4) { draw.within(-60.0, 60.0) } else { 0.0 });
                force[2] = draw.within(-100.0, 400.0);
                change.desired_force = Some(force);
            }
            4 => {
                let all = [ResetPolicy::ContactLoss, ResetPolicy::AsPrinted, ResetPolicy::Never];
                change.reset_policy = Some(draw.one_of(&all));
            }
            5 => change.saturation = Some(draw.one_of(&[Saturation::Continuous, Saturation::AsPrinted])),
            6 => change.search = Some(draw.one_of(&[Search::Tapered, Search::Sign])),
            7 => change.offset_anti_windup = Some(draw.one_in(2)),
            8 => change.stall_release = Some(draw.one_in(2)),
            9 => change.taper = Some(draw.of_any_size(0.01, 1.0)),
            10 => change.mean_speed = Some(draw.of_any_size(0.02, 1.0)),
            _ => change.target_position = sane.target_position.map(|t| t.map(|x| x + draw.within(-0.03, 0.03))),
        }
    }
    change
}

/// A change that brings a whole set back, whatever is in force.
fn back_to(sane: &Parameters) -> OperatorChange {
    OperatorChange {
        at_tick: 0,
        target_position: sane.target_position,
        desired_force: Some(sane.desired_force),
        stiffness: Some(sane.stiffness),
        max_force: Some(sane.max_force),
        position_bound: Some(sane.position_bound),
        reset_policy: Some(sane.reset_policy),
        saturation: Some(sane.saturation),
        search: Some(sane.search),
        taper: Some(sane.taper),
        search_scale: Some(sane.search_scale),
        force_resolution: Some(sane.force_resolution),
        gravity_compensation: Some(sane.gravity_compensation),
        offset_anti_windup: Some(sane.offset_anti_windup),
        stall_release: Some(sane.stall_release),
        mean_speed: Some(sane.mean_speed),
        max_acceleration: Some(sane.max_acceleration),
    }
}

/// What must hold at every tick, under every set.
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

/// Whether the reference has arrived, the foot is with it, and the wished force is there.
fn is_restored(snapshot: &Snapshot, sane: &Parameters) -> bool {
    let Snapshot { state, reference, .. } = snapshot;
    let target = sane.target_position.unwrap();
    let with_it = (0..3).all(|axis| {
        let arrived = (reference.position[axis] - target[axis]).abs() < 1e-6;
        arrived && (state.foot_position[axis] - reference.position[axis]).abs() < sane.position_bound[axis]
    });
    with_it && (state.foot_force[2] - DESIRED_N).abs() < MET * DESIRED_N
}

fn run(mut simulation: Simulation, sane: &Parameters, seed: u64) -> Result<Outcome, String> {
    let mut draw = Draw::new(seed);
    let mut outcome = Outcome { settled_after: 0, lost_contact: false, saturated: false };
    let mut step = |simulation: &mut Simulation| -> Result<Snapshot, String> {
        let snapshot = *simulation.step().map_err(|error| error.to_string())?;
        check(&snapshot)?;
        let (force, set) = (snapshot.command.request.force, snapshot.operator.at(snapshot.state.tick));
        outcome.lost_contact |= snapshot.state.foot_force == [0.0; 3];
        outcome.saturated |= (0..3).any(|axis| force[axis].abs() >= 0.999 * set.max_force[axis]);
        Ok(snapshot)
    };
    for _ in 0..draw.whole(3, 6) {
        let change = any_change(&mut draw, sane);
        simulation.change(&change).ok_or("no room for a change")?;
        for _ in 0..draw.whole(5, 60) {
            step(&mut simulation)?;
        }
    }
    let (_, from) = simulation.change(&back_to(sane)).ok_or("no room for the way back")?;
    let mut since = None;
    loop {
        let snapshot = step(&mut simulation)?;
        let tick = snapshot.state.tick;
        since = if tick >= from && is_restored(&snapshot, sane) { since.or(Some(tick)) } else { None };
        if let Some(first) = since.filter(|first| tick - first >= HELD_TICKS) {
            outcome.settled_after = first - from;
            return Ok(outcome);
        }
        if tick - from > PATIENCE_TICKS {
            let (foot, force) = (snapshot.state.foot_position, snapshot.state.foot_force);
            let reference = snapshot.reference.position;
            return Err(format!("not back after {PATIENCE_TICKS} ticks: x = {foot:?}, x_d = {reference:?}, F = {force:?}"));
        }
    }
}

#[test]
fn random_changes_keep_every_bound_and_sane_ones_bring_the_contact_back() {
    let (start, sane) = pressing();
    let results = for_each_seed(SEQUENCES, |seed| run(start.clone(), &sane, seed).map_err(|what| format!("seed {seed}: {what}")));
    let (done, failed): (Vec<_>, Vec<_>) = results.into_iter().partition(Result::is_ok);
    let done: Vec<Outcome> = done.into_iter().flatten().collect();
    let failed: Vec<String> = failed.into_iter().filter_map(Result::err).collect();
    let longest = done.iter().map(|outcome| outcome.settled_after).max().unwrap_or(-1);
    let mean = done.iter().map(|outcome| outcome.settled_after).sum::<i64>() as f64 / done.len().max(1) as f64;
    let lost = done.iter().filter(|outcome| outcome.lost_contact).count();
    let saturated = done.iter().filter(|outcome| outcome.saturated).count();
    println!(
        "{SEQUENCES} sequences of changes: {} failed; back after {mean:.0} ms on average, {longest} ms at most; contact lost in \
         {lost}, F_max reached in {saturated}",
        failed.len()
    );
    assert!(
        failed.is_empty(),
        "{} of {SEQUENCES} failed, first of all:\n{}",
        failed.len(),
        failed[..failed.len().min(5)].join("\n")
    );
    // Or else the changes were harmless.
    assert!(lost > 0 && saturated > 0);
}
