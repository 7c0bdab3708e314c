//! The attractor with a continuous force at re-entry: energy, continuity, and what it shares with the printed one.

use crate::draw::*;
use hapfic_controller::{Attractor, ContinuousAttractor, ForceProfile};
use hapfic_messages::Saturation;
use proptest::prelude::*;

/// Slope of the force at re-entry over F_c(e) / e.
const SLOPE: f64 = 2.5;

/// Runs a path of the error in shares of x_b; `free` says for each of its legs whether it is free of contact.
fn gained(knots: &[f64], free: &[bool], profile: &ForceProfile) -> (f64, f64) {
    let mut state = ContinuousAttractor::default();
    let (mut gained, mut squares, mut length) = (0.0, 0.0, 0.0);
    for (leg, ends) in knots.windows(2).enumerate() {
        let ends = [ends[0] * profile.position_bound, ends[1] * profile.position_bound];
        let segments = segments(&ends);
        gained += work(&segments, |error, error_rate| {
            let (next, force) = state.step(error, error_rate, if free[leg % free.len()] { 0.0 } else { f64::INFINITY }, profile);
            state = next;
            force
        });
        squares += segments.iter().map(|(from, to)| ((to - from) / f64::from(SAMPLES)).powi(2)).sum::<f64>();
        length += segments.iter().map(|(from, to)| (to - from).abs()).sum::<f64>();
    }
    // As in `sampling_error`, but at both ends of a loop, and with a rise that is only K0 / 2 steeper than the fall: a
    // loop of size D loses K0 D^2 / 4, and half a sample h late it seems to gain K0 D h / 2 at either end.
    (gained, profile.stiffness * squares + 1e-12 * profile.max_force * length)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2048, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn continuous_reentry_closed_cycle_gains_no_energy(
        profile in softening(),
        knots in cycle(),
        free in prop_oneof![Just(vec![true]), prop::collection::vec(any::<bool>(), 1..9)],
    ) {
        let (gained, allowed) = gained(&knots, &free, &profile);
        prop_assert!(gained <= allowed, "gained {gained} J, sampling explains {allowed} J");
    }

    #[test]
    fn continuous_reentry_cycles_on_one_side_gain_no_energy(
        profile in softening(),
        shares in prop::collection::vec(0.05_f64..2.0, 2..12),
    ) {
        // Without the reference in between, which clears the past.
        let mut knots = shares;
        knots.push(knots[0]);
        let (gained, allowed) = gained(&knots, &[true], &profile);
        prop_assert!(gained <= allowed, "gained {gained} J, sampling explains {allowed} J");
        // Sensitivity: a tenth more force in convergence is detected.
        let knots: Vec<f64> = knots.iter().map(|share| share * profile.position_bound).collect();
        let generous = work(&segments(&knots), |error, error_rate| {
            profile.force(error) * if error * error_rate < 0.0 { 1.1 } else { 1.0 }
        });
        prop_assert!(generous > allowed, "undetected gain of {generous} J, sampling explains {allowed} J");
    }

    #[test]
    fn continuous_reentry_free_motion_has_continuous_force(
        profile in softening(),
        shares in prop::collection::vec(0.01_f64..2.0, 3..12),
        side in prop::sample::select(vec![-1.0, 1.0]),
    ) {
        let knots: Vec<f64> = shares.iter().map(|share| side * share * profile.position_bound).collect();
        let mut state = ContinuousAttractor::default();
        let mut last: Option<(f64, f64)> = None;
        let mut steepest = 0.0_f64;
        work(&segments(&knots), |error, error_rate| {
            let (next, force) = state.step(error, error_rate, 0.0, &profile);
            state = next;
            if let Some((error_before, force_before)) = last {
                let most = SLOPE * profile.stiffness * (error - error_before).abs();
                // A convergence that brakes with more than the profile ends at the profile where the robot turns back.
                let limit = profile.force(error).abs();
                let braking = force_before.clamp(-limit, limit);
                let turned = error * error_rate > 0.0 && force * error <= 0.0;
                let change = (force - force_before).abs().min(if turned { (force - braking).abs() } else { f64::INFINITY });
                steepest = steepest.max(change - most);
            }
            last = Some((error, force));
            force
        });
        prop_assert!(steepest <= 1e-9 * profile.max_force, "{steepest} N more than {SLOPE} K0 |de|");
    }

    #[test]
    fn continuous_reentry_first_convergence_is_printed_one(
        profile in softening(),
        start in -2.0_f64..2.0,
        farther in 0.01_f64..1.0,
        back in 0.0_f64..1.0,
    ) {
        let farthest = start + farther.copysign(start);
        let knots = [start, farthest, back * farthest].map(|share| share * profile.position_bound);
        let (mut continuous, mut printed) = (ContinuousAttractor::default(), Attractor::default());
        let mut difference = 0.0_f64;
        work(&segments(&knots), |error, error_rate| {
            let (a, force) = continuous.step(error, error_rate, 0.0, &profile);
            let (b, expected) = printed.step(error, error_rate, &profile);
            (continuous, printed) = (a, b);
            difference = difference.max((force - expected).abs());
            force
        });
        prop_assert!(difference <= 1e-12 * profile.max_force, "{difference} N");
    }

    #[test]
    fn continuous_reentry_in_contact_is_printed_law(
        profile in softening(),
        hardening in 0.5_f64..20.0,
        path in prop::collection::vec(
            (prop_oneof![4 => -2.0_f64..2.0, 1 => Just(0.0)], prop_oneof![4 => -1.0_f64..1.0, 1 => Just(0.0)]),
            1..80,
        ),
    ) {
        let profile = ForceProfile { max_force: hardening * profile.max_force, ..profile };
        let (mut continuous, mut printed) = (ContinuousAttractor::default(), Attractor::default());
        for (share, error_rate) in path {
            let error = share * profile.position_bound;
            let (a, force) = continuous.step(error, error_rate, f64::INFINITY, &profile);
            let (b, expected) = printed.step(error, error_rate, &profile);
            (continuous, printed) = (a, b);
            prop_assert!((force - expected).abs() <= 1e-12 * profile.max_force, "{force} N, printed {expected} N at {error}");
            prop_assert_eq!(a.converging, b.converging);
        }
    }

    #[test]
    fn continuous_reentry_reference_moves_nearer_keeps_pull(
        profile in softening(),
        farthest in 0.1_f64..2.0,
        stop in 0.5_f64..1.0,
        nearer in 0.0_f64..1.0,
    ) {
        // In divergence the error falls without a rate while the offset returns.
        let profile = ForceProfile { saturation: Saturation::Softening, ..profile };
        let bound = profile.position_bound;
        let (mut state, mut pull) = (ContinuousAttractor::default(), 0.0);
        for (share, rate) in [(farthest, 0.1), (farthest, -0.1), (stop * farthest, -0.1), (stop * farthest, 0.1)] {
            (state, pull) = state.step(share * bound, rate, 0.0, &profile);
        }
        let (_, now) = state.step(nearer * stop * farthest * bound, 0.1, 0.0, &profile);
        let most = profile.force(nearer * stop * farthest * bound);
        prop_assert!((now - pull.min(most)).abs() <= 1e-9 * profile.max_force, "{now} N after {pull} N, profile {most} N");
    }

    #[test]
    fn continuous_reentry_any_input_within_limit(
        start in (finite(), finite(), any::<bool>()),
        steps in prop::collection::vec((any_number(), any_number(), any::<bool>(), profile()), 1..40),
    ) {
        let mut state = ContinuousAttractor { x_max_m: start.0, x_max_force: start.1, converging: start.2 };
        for (error, error_rate, free, profile) in steps {
            let (next, force) = state.step(error, error_rate, if free { 0.0 } else { f64::INFINITY }, &profile);
            prop_assert!(force.abs() <= profile.largest(), "{force} N from {state:?} at {error}, {error_rate}");
            prop_assert!(next.x_max_m.is_finite() && next.x_max_force.abs() <= profile.largest(), "{next:?} from {state:?}");
            state = next;
        }
        for bad in NOT_FINITE {
            let broken = ContinuousAttractor { x_max_m: bad, ..state };
            let profile = ForceProfile {
                stiffness: 1e3, max_force: 50.0, position_bound: 0.05, saturation: Saturation::Softening,
            };
            prop_assert_eq!(broken.step(0.01, -0.1, 0.0, &profile).1, 0.0);
            prop_assert_eq!(state.step(bad, 0.1, 0.0, &profile).1, 0.0);
        }
    }
}
