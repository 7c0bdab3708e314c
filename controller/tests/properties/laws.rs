//! Bounds and energy of the laws, for every input.

use crate::draw::*;
use hapfic_controller::task_space;
use hapfic_controller::{
    Attractor, ForceProfile, HapticParameters, HapticSearch, LowPass, Stall, bumpless_offset, conditional_integration, limit,
};
use hapfic_messages::{ControllerState, MAX_JOINTS, ResetPolicy, Saturation, Search};
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn profile_any_error_within_f_max(profile in profile(), error in any_number()) {
        let force = profile.force(error);
        prop_assert!(force.abs() <= profile.max_force.max(0.0), "{force} N");
        prop_assert_eq!(profile.force(-error), -force);
    }

    #[test]
    fn profile_softening_pulls_to_reference(profile in softening(), error in -0.2_f64..0.2) {
        let force = profile.force(error);
        prop_assert!(force * error >= 0.0);
        // A softening profile bends over within the last 5 %; where the clamped line ends, it lies 0.05 (1 - tanh 1) below.
        let bend = if profile.saturation == Saturation::Softening { 0.05 * (1.0 - 1.0_f64.tanh()) } else { 0.0 };
        let line = (profile.stiffness * error).clamp(-profile.max_force, profile.max_force);
        prop_assert!((force - line).abs() <= (bend + 1e-12) * profile.max_force, "{force} N, line {line} N");
    }

    #[test]
    fn attractor_any_error_within_f_max(steps in prop::collection::vec((any_number(), any_number(), profile()), 1..60)) {
        let mut state = Attractor::default();
        for (error, error_rate, profile) in steps {
            let (next, force) = state.step(error, error_rate, &profile);
            prop_assert!(force.abs() <= profile.max_force.max(0.0), "{force} N from {state:?} at {error}, {error_rate}");
            prop_assert!(next.x_max_m.is_finite());
            state = next;
        }
    }

    #[test]
    fn haptic_search_any_force_within_bound(
        steps in prop::collection::vec((any_number(), any_number(), haptic_parameters()), 1..60),
    ) {
        let mut state = HapticSearch::default();
        for (desired, measured, p) in steps {
            state = state.step(desired, measured, &p);
            prop_assert!(state.offset_m.abs() <= p.position_bound.max(0.0), "{state:?} with {p:?}");
        }
    }

    #[test]
    fn haptic_search_step_reduces_force_error(
        desired in -100.0_f64..100.0,
        measured in -100.0_f64..100.0,
        offset_m in -0.01_f64..0.01,
        search in prop::sample::select(Search::ALL.to_vec()),
        period_s in 1e-4_f64..1e-2,
    ) {
        prop_assume!(measured.abs() > 0.01 && (desired - measured).abs() > 0.01 && desired != 0.0);
        let p = HapticParameters {
            stiffness: 2000.0,
            position_bound: 1.0,
            search,
            reset_policy: ResetPolicy::ContactLoss,
            taper: 0.2,
            search_scale: 0.01,
            force_resolution: 0.01,
            period_s,
        };
        let moved = HapticSearch { offset_m }.step(desired, measured, &p).offset_m - offset_m;
        // The reaction along +x grows when the reference moves towards -x, for either sign of F_d.
        prop_assert!(moved * (desired - measured) < 0.0);
        let full = 0.01 * desired.abs() / 2000.0 * (period_s / 1e-3);
        let tapered = 0.2 * (desired - measured).abs() / 2000.0 * (period_s / 1e-3);
        let most = match search {
            Search::Sign => full,
            Search::Tapered => full.min(tapered),
            Search::Adaptive => tapered,
        };
        prop_assert!(moved.abs() <= most * (1.0 + 1e-9) + 1e-15, "moved {moved}, largest step {most}");
    }

    #[test]
    fn task_space_any_input_within_bounds(steps in prop::collection::vec((input(), parameters()), 1..30)) {
        let mut state = ControllerState::default();
        for (input, p) in steps {
            let output = task_space::step(state, &input, &p, PERIOD_S);
            prop_assert!(output.is_ok(), "{output:?}");
            let output = output.unwrap();
            for axis in 0..3 {
                prop_assert!(output.force[axis].abs() <= p.max_force[axis], "{output:?} with {p:?}");
                prop_assert!(output.state.offset[axis].abs() <= p.position_bound[axis], "{output:?} with {p:?}");
                prop_assert!(output.state.x_max[axis].is_finite() && output.state.converging[axis] <= 1);
            }
            state = output.state;
        }
    }

    #[test]
    fn attractor_closed_cycle_gains_no_energy(profile in softening(), knots in cycle()) {
        let knots: Vec<f64> = knots.iter().map(|share| share * profile.position_bound).collect();
        let segments = segments(&knots);
        let mut state = Attractor::default();
        let gained = work(&segments, |error, error_rate| {
            let (next, force) = state.step(error, error_rate, &profile);
            state = next;
            force
        });
        let allowed = sampling_error(&segments, &profile);
        prop_assert!(gained <= allowed, "gained {gained} J, sampling explains {allowed} J");

        // Sensitivity: the check detects a law that returns a tenth more force in convergence.
        let generous = work(&segments, |error, error_rate| {
            profile.force(error) * if error * error_rate < 0.0 { 1.1 } else { 1.0 }
        });
        prop_assert!(generous > allowed, "undetected gain of {generous} J");
    }

    #[test]
    fn stall_release_closed_cycle_gains_no_energy(profile in softening(), knots in cycle()) {
        let knots: Vec<f64> = knots.iter().map(|share| share * profile.position_bound).collect();
        let segments = segments(&knots);
        let gained = work_with_pauses(&segments, &profile);
        let allowed = sampling_error(&segments, &profile);
        prop_assert!(gained <= allowed, "gained {gained} J, sampling explains {allowed} J");
    }

    #[test]
    fn stall_release_repeated_offers_less_energy(
        profile in softening(),
        farthest in prop_oneof![-2.0_f64..-0.1, 0.1_f64..2.0],
        stops in prop::collection::vec(0.3_f64..0.99, 1..8),
    ) {
        let mut state = (Attractor::default(), Stall::default());
        let mut error = farthest * profile.position_bound;
        state = released(state, error, -error.signum() * 0.1, &profile).0;
        for share in stops {
            error *= share;
            state = released(state, error, -error.signum() * 0.1, &profile).0;
            let before = state.0;
            let pull = released(state, error, 0.0, &profile).1 * error.signum();
            let offered = |x_max: f64| profile.force(x_max.abs()) * x_max.abs() / 4.0;
            let mut force = pull;
            for _ in 0..PAUSE {
                let (next, now) = released(state, error, 0.0, &profile);
                (state, force) = (next, now * error.signum());
            }
            // A release occurs if it gains force. Its force is within the profile's, and its energy within the previous
            // one's.
            if profile.force(error.abs()) - pull > 0.01 {
                prop_assert_eq!(state.0, Attractor { x_max_m: error, converging: true });
                prop_assert!(force > pull && force <= profile.force(error.abs()));
                prop_assert!(error.abs() <= before.x_max_m.abs() && offered(error) <= offered(before.x_max_m));
            } else {
                prop_assert_eq!(state.0, before);
            }
        }
    }

    #[test]
    fn task_space_with_improvements_within_bounds(
        steps in prop::collection::vec((input(), parameters(), prop::option::weighted(0.3, state())), 1..30),
    ) {
        let mut state = ControllerState::default();
        for (input, p, other) in steps {
            let p = improved(p);
            let from = other.unwrap_or(state);
            let output = task_space::step(from, &input, &p, PERIOD_S);
            prop_assert!(output.is_ok(), "{output:?}");
            let output = output.unwrap();
            for axis in 0..3 {
                prop_assert!(output.force[axis].abs() <= p.max_force[axis], "{output:?} with {p:?}");
                prop_assert!(output.state.offset[axis].abs() <= p.position_bound[axis], "{output:?} with {p:?}");
                let largest = p.max_force[axis].min(p.stiffness[axis] * p.position_bound[axis]);
                prop_assert!(output.state.force[axis].abs() <= largest, "{output:?} with {p:?}");
                prop_assert_eq!(output.state.stiffness[axis], p.stiffness[axis]);
            }
            state = output.state;
        }
    }

    #[test]
    fn conditional_integration_saturated_blocks_windup(
        before in -0.02_f64..0.02,
        wanted in -0.02_f64..0.02,
        force in -1.0_f64..1.0,
        max_force in 0.1_f64..2.0,
    ) {
        let force = force.clamp(-max_force, max_force);
        let taken = conditional_integration(before, wanted, force, max_force);
        prop_assert!(taken == before || taken == wanted);
        let deeper = (taken - before) * force > 0.0 && taken.abs() > before.abs();
        prop_assert!(!(deeper && force.abs() >= 0.999 * max_force), "{before} -> {taken} at {force} of {max_force} N");
        if force.abs() < 0.999 * max_force || (wanted - before) * force <= 0.0 || wanted.abs() <= before.abs() {
            prop_assert_eq!(taken, wanted);
        }
    }

    #[test]
    fn bumpless_offset_any_input_within_bound(
        distance in finite(),
        force in finite(),
        stiffness in parameter(),
        max_force in parameter(),
        position_bound in parameter(),
    ) {
        let profile = ForceProfile { stiffness, max_force, position_bound, saturation: Saturation::Continuous };
        let offset = bumpless_offset(distance, force, &profile);
        prop_assert!(offset.abs() <= position_bound.max(0.0), "{offset}");
    }

    #[test]
    fn bumpless_offset_reachable_force_kept(
        distance in -0.1_f64..0.1,
        force in -300.0_f64..300.0,
        stiffness in 1.0_f64..1e5,
        max_force in 1.0_f64..400.0,
        position_bound in 1e-4_f64..1.0,
    ) {
        let profile = ForceProfile { stiffness, max_force, position_bound, saturation: Saturation::Continuous };
        let offset = bumpless_offset(distance, force, &profile);
        let wanted = force.clamp(-max_force, max_force);
        let given = profile.force(distance + offset);
        if offset.abs() < position_bound {
            prop_assert!(given.abs() <= wanted.abs() + 1e-9 * stiffness.max(1.0), "{given} N instead of {wanted} N");
            if wanted.abs() <= 0.95 * stiffness * position_bound {
                prop_assert!((given - wanted).abs() <= 1e-9 * stiffness.max(1.0), "{given} N instead of {wanted} N");
            }
        }
    }

    #[test]
    fn attractor_convergence_returns_no_energy(
        profile in softening(),
        hardening in 0.1_f64..20.0,
        farthest in prop_oneof![-2.0_f64..-0.01, 0.01_f64..2.0],
    ) {
        // Holds for every profile, also a hardening one.
        let profile = ForceProfile { max_force: profile.max_force * hardening, ..profile };
        let farthest = farthest * profile.position_bound;
        let mut state = Attractor::default();
        let returned = work(&[(farthest, 0.0)], |error, error_rate| {
            let (next, force) = state.step(error, error_rate, &profile);
            state = next;
            force
        });
        // The law detects the convergence half a sample late: F_c |M| / |x_max| h / 2, and |M| < 2 |x_max|.
        let allowed = profile.force(farthest.abs()) * farthest.abs() / f64::from(SAMPLES);
        prop_assert!(returned.abs() <= allowed, "returned {returned} J, sampling explains {allowed} J");
    }

    #[test]
    fn low_pass_any_torque_within_inputs(
        torques in prop::collection::vec(any_number(), 1..60),
        cutoff in prop::option::of(any_number()),
        peak in any_number(),
    ) {
        let mut state = LowPass::default();
        let mut largest = 0.0_f64;
        for torque in torques {
            state = state.step(&[torque; MAX_JOINTS], cutoff, PERIOD_S);
            largest = if torque.is_finite() { largest.max(torque.abs()) } else { largest };
            let (limited, bits) = limit(&state.output, &[peak; MAX_JOINTS]);
            for (output, limited) in state.output.iter().zip(limited) {
                prop_assert!(output.abs() <= largest * (1.0 + 1e-12) + f64::MIN_POSITIVE, "{output} from at most {largest}");
                prop_assert!(limited.is_finite() && limited.abs() <= peak.max(0.0));
                prop_assert_eq!(bits != 0, limited != *output);
            }
        }
    }
}
