//! Improvements over the printed law (decision 8), each against the problem that it solves.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use hapfic_controller::task_space::{self, TaskSpaceInput};
use hapfic_controller::{Attractor, ForceProfile, Stall, StallInput};
use hapfic_messages::{ControllerState, Parameters, ResetPolicy, Saturation, Search};

const PERIOD_S: f64 = 1e-3;

/// Parameters with both improvements.
fn improved() -> Parameters {
    Parameters {
        stiffness: [6000.0; 3],
        max_force: [150.0; 3],
        position_bound: [0.025; 3],
        reset_policy: ResetPolicy::ContactLoss.code(),
        saturation: Saturation::Continuous.code(),
        search: Search::Tapered.code(),
        offset_anti_windup: 1,
        stall_release: 1,
        taper: 0.2,
        search_scale: 0.01,
        force_resolution: 0.01,
        ..Parameters::default()
    }
}

/// Parameters without the improvements, as in the paper.
fn printed(p: Parameters) -> Parameters {
    Parameters { offset_anti_windup: 0, stall_release: 0, ..p }
}

/// Simulates a mass of 2 kg with a damper [N s/m] from 0.2 m off its reference, and returns the errors [m].
fn errors_of_damped_mass(p: &Parameters, damper: f64, ticks: usize) -> Vec<f64> {
    const MASS_KG: f64 = 2.0;
    const SUBSTEPS: u32 = 10;
    let h = PERIOD_S / f64::from(SUBSTEPS);
    let (mut position, mut velocity) = (-0.2, 0.0);
    let mut state = ControllerState::default();
    let mut errors = Vec::with_capacity(ticks);
    for _ in 0..ticks {
        let input =
            TaskSpaceInput { position: [position, 0.0, 0.0], velocity: [velocity, 0.0, 0.0], ..TaskSpaceInput::default() };
        let output = task_space::step(state, &input, p, PERIOD_S).unwrap();
        state = output.state;
        errors.push(output.error[0]);
        for _ in 0..SUBSTEPS {
            velocity = (velocity + h * output.force[0] / MASS_KG) / (1.0 + h * damper / MASS_KG);
            position += h * velocity;
        }
    }
    errors
}

#[test]
fn stall_release_strong_damping_reaches_reference() {
    // Eq. 1: critical damping is 2 sqrt(2 F_max m / x_max) = 110 N s/m; without release the mass rests at x_max / 2 =
    // 0.1 m.
    let stalled = errors_of_damped_mass(&printed(improved()), 130.0, 1500);
    assert!(stalled[800..].iter().all(|e| (e - 0.1).abs() < 1e-3), "rests at {} m", stalled[1499]);
    let released = errors_of_damped_mass(&improved(), 130.0, 1500);
    assert!(released[1400..].iter().all(|e| e.abs() < 1e-5), "is at {} m", released[1499]);
    // Weakly damped, it released without.
    let free = errors_of_damped_mass(&printed(improved()), 100.0, 1500);
    assert!(free[1400..].iter().all(|e| e.abs() < 1e-5), "is at {} m", free[1499]);
}

#[test]
fn stall_release_halving_stops_return_third_of_energy() {
    // Eq. 1 with a linear profile: K0 M^2 / 4 (1 + 1/4 + 1/16 + ...) = K0 M^2 / 3 of the stored K0 M^2 / 2.
    let profile = ForceProfile { stiffness: 1000.0, max_force: 1e3, position_bound: 1.0, saturation: Saturation::Continuous };
    let (mut attractor, mut stall) = (Attractor::default(), Stall::default());
    let mut tick = |error: f64, error_rate: f64| {
        let (next, force) = attractor.step(error, error_rate, &profile);
        let stall_input = StallInput { error, error_rate, force, contact_force: 0.0, force_resolution: 0.01, period_s: PERIOD_S };
        let (after, released, force) = stall.step(next, &stall_input, &profile);
        (stall, attractor) = (after, released);
        force
    };
    let (mut from, mut returned) = (0.5, 0.0);
    for _ in 0..8 {
        let way = from / 2.0;
        for i in 0..1000 {
            let error = from - way * (f64::from(i) + 0.5) / 1000.0;
            returned += tick(error, -0.1) * way / 1000.0;
        }
        from -= way;
        for _ in 0..25 {
            tick(from, 0.0);
        }
    }
    let third = 1000.0 * 0.5 * 0.5 / 3.0;
    assert!((returned - third).abs() < 0.01 * third, "{returned} J instead of {third} J");
}

#[test]
fn stall_not_at_rest_resets_count() {
    let profile = ForceProfile { stiffness: 1000.0, max_force: 40.0, position_bound: 0.05, saturation: Saturation::Continuous };
    let stalled = Attractor { x_max_m: 0.2, converging: true };
    let stall_input =
        StallInput { error: 0.1, error_rate: 0.0, force: 0.0, contact_force: 0.0, force_resolution: 0.01, period_s: PERIOD_S };
    let nearly = Stall { at_rest_ticks: 19 };
    let (after, attractor, force) = nearly.step(stalled, &stall_input, &profile);
    assert_eq!((after, attractor.x_max_m, force), (Stall::default(), 0.1, profile.force(0.1)));
    let (after, attractor, force) = Stall { at_rest_ticks: 18 }.step(stalled, &stall_input, &profile);
    assert_eq!((after, attractor, force), (nearly, stalled, 0.0));
    let diverging = Attractor { converging: false, ..stalled };
    for (attractor, input) in [
        (diverging, stall_input),
        (stalled, StallInput { error_rate: -1e-3, ..stall_input }),
        (stalled, StallInput { contact_force: -0.02, ..stall_input }),
        (stalled, StallInput { error_rate: f64::NAN, ..stall_input }),
        (stalled, StallInput { contact_force: f64::NAN, ..stall_input }),
    ] {
        assert_eq!(nearly.step(attractor, &input, &profile), (Stall::default(), attractor, 0.0), "{input:?}");
    }
    // A release that gains no force does not occur; the count continues.
    let held = StallInput { force: profile.force(0.1) - 0.005, ..stall_input };
    assert_eq!(nearly.step(stalled, &held, &profile), (Stall { at_rest_ticks: 20 }, stalled, held.force));
}

/// Presses on a rigid wall with a desired force beyond F_max, then with 10 N.
///
/// Returns the offset at the end of the first part [m], and the ticks that the second part needs.
fn beyond_the_limit(p: &Parameters) -> (f64, usize) {
    let (mut state, mut measured) = (ControllerState::default(), 0.0);
    let mut tick = |desired: f64| {
        let p = Parameters { desired_force: [0.0, 0.0, desired], ..*p };
        let input = TaskSpaceInput {
            reference_position: [0.0, 0.0, -0.001],
            contact_force: [0.0, 0.0, measured],
            ..TaskSpaceInput::default()
        };
        let output = task_space::step(state, &input, &p, PERIOD_S).unwrap();
        state = output.state;
        measured = -output.force[2];
        (measured, state.offset[2])
    };
    for _ in 0..499 {
        tick(200.0);
    }
    let (reached, offset) = tick(200.0);
    assert!((reached - 20.0).abs() < 0.05, "{reached} N");
    let ticks = (1..5000).find(|_| (tick(10.0).0 - 10.0).abs() < 0.1).expect("10 N within 5 s");
    (offset, ticks)
}

#[test]
fn anti_windup_saturated_force_stops_offset() {
    let p = Parameters { stiffness: [2000.0; 3], max_force: [20.0; 3], position_bound: [0.05; 3], ..improved() };
    let (offset, ticks) = beyond_the_limit(&printed(p));
    assert!(offset <= -0.05 && ticks > 800, "{offset} m, {ticks} ticks");
    let (offset, ticks) = beyond_the_limit(&p);
    assert!((-0.0101..-0.008).contains(&offset) && ticks < 200, "{offset} m, {ticks} ticks");
}

#[test]
fn anti_windup_gain_change_keeps_force() {
    // In contact with a matched force the search is at rest. The target is 1 mm deep: K0 (dx + d) = 2000 (-0.003 -
    // 0.001) N.
    let input = TaskSpaceInput { contact_force: [8.0; 3], reference_position: [-0.001; 3], ..TaskSpaceInput::default() };
    let with = |stiffness: f64, max_force: f64, p: Parameters| Parameters {
        stiffness: [stiffness; 3],
        max_force: [max_force; 3],
        desired_force: [8.0; 3],
        ..p
    };
    let start = ControllerState { offset: [-0.003; 3], ..ControllerState::default() };
    let after = |from: ControllerState, p: &Parameters| task_space::step(from, &input, p, PERIOD_S).unwrap();

    let found = after(start, &with(2000.0, 150.0, improved()));
    assert!((found.force[0] + 8.0).abs() < 1e-12);
    for stiffness in [500.0, 4000.0, 6000.0, 1e5] {
        let force = after(found.state, &with(stiffness, 150.0, improved())).force[0];
        assert!((force + 8.0).abs() < 1e-9, "{stiffness} N/m: {force} N");
        let as_printed = after(found.state, &with(stiffness, 150.0, printed(improved()))).force[0];
        assert!((as_printed + 8.0).abs() > 1.0, "{stiffness} N/m: {as_printed} N");
    }
    // A convergence keeps its force too.
    let converging = ControllerState { x_max: [-0.0045; 3], converging: [1; 3], ..found.state };
    let old = after(converging, &with(2000.0, 150.0, improved()));
    assert!(old.state.converging[0] == 1 && old.force[0] < -4.0, "{old:?}");
    let new = after(old.state, &with(6000.0, 150.0, improved()));
    assert!((old.force[0] - new.force[0]).abs() < 1e-9, "{old:?} {new:?}");
    // The force that F_max limited does not return immediately.
    let held = after(found.state, &with(2000.0, 3.0, improved()));
    assert!((held.force[0] + 3.0).abs() < 1e-9);
    let freed = after(held.state, &with(2000.0, 150.0, improved()));
    assert!((freed.force[0] + 3.0).abs() < 1e-9, "{}", freed.force[0]);
    // A linear part that ends below the force limits it to 0.95 K0 x_b (eq. 4).
    let soft = after(found.state, &with(100.0, 150.0, improved()));
    assert!((soft.force[0] + 0.95 * 100.0 * 0.025).abs() < 1e-9, "{}", soft.force[0]);
    // A tighter bound, within which dx can still compensate the target's depth: 0.95 K0 x_b (eq. 4).
    let tight = Parameters { position_bound: [0.003; 3], ..with(2000.0, 150.0, improved()) };
    let force = after(found.state, &tight).force[0];
    assert!((force + 0.95 * 2000.0 * 0.003).abs() < 1e-9, "{force}");
    assert_eq!(after(start, &with(6000.0, 150.0, improved())).state.offset[0], -0.003, "no previous tick");
    // Gains that move the force towards the desired force keep dx.
    let hard = TaskSpaceInput { contact_force: [80.0; 3], ..input };
    let pressing = ControllerState { force: [-80.0; 3], ..found.state };
    let relaxed = task_space::step(pressing, &hard, &with(1000.0, 150.0, improved()), PERIOD_S).unwrap();
    assert!(relaxed.force[0] > -8.0, "{}", relaxed.force[0]);
    // The next tick has the same gains and keeps the offset.
    let p = with(6000.0, 150.0, improved());
    let next = after(found.state, &p).state;
    assert_eq!(after(next, &p).state.offset[0], next.offset[0]);
    // Without contact there is no force to keep, and no offset.
    let air = TaskSpaceInput { contact_force: [0.0; 3], ..input };
    assert_eq!(task_space::step(found.state, &air, &p, PERIOD_S).unwrap().state.offset[0], 0.0);
}
