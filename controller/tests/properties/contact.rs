//! Force hold: changes beside the force, in a contact under a desired force.

use crate::draw::*;
use hapfic_controller::ForceProfile;
use hapfic_controller::task_space::{self, TaskSpaceInput, TaskSpaceOutput};
use hapfic_messages::{ControllerState, Parameters, Saturation};
use proptest::prelude::*;

/// K0, F_max and x_b of an axis.
fn gains() -> impl Strategy<Value = [f64; 3]> {
    (2.0_f64..4.5, 1.0_f64..400.0, -3.3_f64..-1.0)
        .prop_map(|(stiffness, max_force, position_bound)| [10_f64.powf(stiffness), max_force, 10_f64.powf(position_bound)])
}

fn with([stiffness, max_force, position_bound]: [f64; 3], desired: f64) -> Parameters {
    Parameters {
        stiffness: [stiffness; 3],
        max_force: [max_force; 3],
        position_bound: [position_bound; 3],
        desired_force: [desired, 0.0, 0.0],
        taper: 0.4,
        ..improved(ordinary())
    }
}

fn profile(p: &Parameters) -> ForceProfile {
    ForceProfile {
        stiffness: p.stiffness[0],
        max_force: p.max_force[0],
        position_bound: p.position_bound[0],
        saturation: Saturation::Softening,
    }
}

/// Input whose axis 0 is `distance` before its reference and measures a reaction.
fn touching(distance: f64, measured: f64) -> TaskSpaceInput {
    TaskSpaceInput { reference_position: [distance, 0.0, 0.0], contact_force: [measured, 0.0, 0.0], ..TaskSpaceInput::default() }
}

fn run(state: ControllerState, input: &TaskSpaceInput, p: &Parameters) -> TaskSpaceOutput {
    task_space::step(state, input, p, PERIOD_S).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2048, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn force_hold_gain_change_keeps_reaction_between_measured_and_desired(
        old in gains(),
        new in gains(),
        shares in (-1.0_f64..1.0, -1.5_f64..1.5, -1.0_f64..1.0),
        pair in (1.0_f64..200.0, 1.0_f64..200.0),
        motion in (-0.2_f64..0.2, -0.2_f64..0.2),
        ticks in 1_usize..4,
        taper in 0.0_f64..0.4,
    ) {
        let (measured, desired) = pair;
        let distance = shares.1 * old[2];
        let x_max = shares.2 * old[2];
        let input = TaskSpaceInput {
            velocity: [motion.0, 0.0, 0.0],
            reference_velocity: [motion.1, 0.0, 0.0],
            ..touching(distance, measured)
        };
        // Some ticks under the old gains, so that the attractor has a phase.
        let offset = [shares.0 * old[2], 0.0, 0.0];
        let mut state = ControllerState {
            offset,
            x_max: [x_max, 0.0, 0.0],
            x_max_force: [0.5 * old[0] * x_max, 0.0, 0.0],
            converging: [u32::from(shares.2 > 0.5); 3],
            taper: [taper; 3],
            ..ControllerState::default()
        };
        for _ in 0..ticks {
            state = run(state, &input, &with(old, desired)).state;
        }
        let p = with(new, desired);
        let after = run(state, &input, &p);
        // The wall balances the change of the attractor's force.
        let (before, force) = (state.force[0], after.state.force[0]);
        let wanted = (before + measured - measured.max(desired), before + measured - measured.min(desired));
        let profile = profile(&p);
        let reach = (profile.force(distance - new[2]), profile.force(distance + new[2]));
        let inverse = 0.9999 * profile.largest();
        // What the limits do not allow comes as near as they do: to an end of what they reach, or to the saturated force.
        let low = wanted.0.min(reach.1).min(inverse);
        let high = wanted.1.max(reach.0).max(-inverse);
        let rounding = 1e-9 * (1.0 + before.abs() + measured + desired);
        prop_assert!(force >= low - rounding && force <= high + rounding,
            "from {before} to {force} N, wanted {wanted:?}, reach {reach:?}, F = {measured}, F_d = {desired}");
        prop_assert!(after.state.offset[0].abs() <= new[2]);
    }

    #[test]
    fn force_hold_moving_reference_keeps_error(
        gains in gains(),
        share in -0.5_f64..0.5,
        distance in -0.02_f64..0.02,
        speeds in prop::collection::vec(-0.3_f64..0.3, 1..20),
        force in 1.0_f64..100.0,
    ) {
        // The force is matched, so the search rests.
        let p = with(gains, force);
        let state = ControllerState { offset: [share * gains[2], 0.0, 0.0], ..ControllerState::default() };
        let mut before = run(state, &touching(distance, force), &p);
        let mut distance = distance;
        for speed in speeds {
            distance += speed * PERIOD_S;
            let input = TaskSpaceInput { reference_velocity: [speed, 0.0, 0.0], ..touching(distance, force) };
            let after = run(before.state, &input, &p);
            if (before.state.offset[0] - speed * PERIOD_S).abs() > gains[2] {
                // dx reaches its bound: it moves no further, and nowhere else.
                prop_assert_eq!(after.state.offset[0], before.state.offset[0]);
                return Ok(());
            }
            prop_assert!((after.error[0] - before.error[0]).abs() <= 1e-12, "{} then {} m", before.error[0], after.error[0]);
            prop_assert!(after.error_rate[0].abs() <= 1e-9, "{} m/s", after.error_rate[0]);
            before = after;
        }
    }

    #[test]
    fn force_hold_lost_contact_keeps_offset_then_returns_slowly(
        gains in gains(),
        share in -1.0_f64..1.0,
        desired in prop_oneof![Just(0.0), 1.0_f64..100.0],
        free in prop::collection::vec(prop::bool::weighted(0.97), 200..400),
    ) {
        let p = with(gains, desired);
        let offset = share * gains[2];
        let mut state = ControllerState { offset: [offset, 0.0, 0.0], ..ControllerState::default() };
        let mut free_ticks = 0;
        for free in free {
            // Contact with the desired force, so that the search rests, or with any force where there is none.
            let measured = if free { 0.0 } else if desired == 0.0 { 5.0 } else { desired };
            free_ticks = if free { free_ticks + 1 } else { 0 };
            let before = state.offset[0];
            state = run(state, &touching(0.0, measured), &p).state;
            let now = state.offset[0];
            prop_assert!((now - before).abs() <= 0.1 * PERIOD_S * (1.0 + 1e-12), "{before} then {now} m");
            prop_assert!(now * before >= 0.0 && now.abs() <= before.abs(), "{before} then {now} m");
            if desired != 0.0 && free_ticks < 50 {
                prop_assert_eq!(now, before, "after {} ms", free_ticks);
            }
            if desired == 0.0 || free_ticks > 50 {
                prop_assert!(now == 0.0 || before.abs() - now.abs() >= 0.1 * PERIOD_S * (1.0 - 1e-9), "{before} then {now} m");
            }
        }
    }

    #[test]
    fn force_hold_bound_shrinks_in_bounce_offset_within_it(gains in gains(), share in 0.0_f64..1.0, shrunk in 0.01_f64..1.0) {
        let state = ControllerState { offset: [share * gains[2], 0.0, 0.0], ..ControllerState::default() };
        let touched = run(state, &touching(0.0, 20.0), &with(gains, 20.0)).state;
        let bound = shrunk * gains[2];
        let now = run(touched, &touching(0.0, 0.0), &with([gains[0], gains[1], bound], 20.0)).state.offset[0];
        prop_assert_eq!(now, touched.offset[0].min(bound));
    }
}
