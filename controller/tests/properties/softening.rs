//! The softening profile and the damping.

use crate::draw::*;
use hapfic_controller::{ForceProfile, damped};
use hapfic_messages::Saturation;
use proptest::prelude::*;

/// A profile with `softening` from ordinary gains, F_max also above `K0 x_b`.
fn any_softening() -> impl Strategy<Value = ForceProfile> {
    (1.0_f64..5.0, -3.0_f64..-1.0, 0.05_f64..20.0).prop_map(|(stiffness, bound, share)| {
        let (stiffness, position_bound) = (10_f64.powf(stiffness), 10_f64.powf(bound));
        let max_force = share * stiffness * position_bound;
        ForceProfile { stiffness, max_force, position_bound, saturation: Saturation::Softening }
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn softening_any_parameters_within_both_limits(
        stiffness in parameter(),
        max_force in parameter(),
        position_bound in parameter(),
        error in any_number(),
    ) {
        let profile = ForceProfile { stiffness, max_force, position_bound, saturation: Saturation::Softening };
        let force = profile.force(error);
        let most = max_force.min(stiffness * position_bound).max(0.0);
        prop_assert!(force.abs() <= most && profile.largest() <= most, "{force} N, {} N, limit {most} N", profile.largest());
        prop_assert!(profile.error_for(error).is_finite());
    }

    #[test]
    fn softening_larger_error_has_no_larger_secant(
        profile in any_softening(),
        share in 1e-3_f64..40.0,
        ratio in 1.0_f64..3.0,
    ) {
        let (near, far) = (share * profile.position_bound, ratio * share * profile.position_bound);
        let (secant_near, secant_far) = (profile.force(near) / near, profile.force(far) / far);
        prop_assert!(secant_far <= secant_near * (1.0 + 1e-14), "{secant_near} then {secant_far} N/m");
        prop_assert!(secant_near <= profile.stiffness * (1.0 + 1e-14));
        // The force itself never falls.
        prop_assert!(profile.force(far) >= profile.force(near) * (1.0 - 1e-14));
        // Sensitivity: the hardening profile of the same gains breaks this beyond its knee.
        let hardening = ForceProfile { saturation: Saturation::Continuous, ..profile };
        if profile.max_force > 1.5 * profile.stiffness * profile.position_bound {
            let (knee, bound) = (0.94 * profile.position_bound, profile.position_bound);
            prop_assert!(hardening.force(bound) / bound > hardening.force(knee) / knee);
        }
    }

    #[test]
    fn softening_error_for_force_gives_force_back(profile in any_softening(), share in -1.2_f64..1.2) {
        let largest = profile.largest();
        let force = share * largest;
        let given = profile.force(profile.error_for(force));
        // Where the tanh saturates, 0.999 of its rise counts as its end.
        let last = (0.95 + 0.05 * 0.999) * largest;
        let expected = force.clamp(-last, last);
        prop_assert!((given - expected).abs() <= 1e-12 * largest, "{given} N instead of {expected} N");
    }

    #[test]
    fn damped_any_input_takes_energy_within_limit(
        share in -1.0_f64..1.0,
        error_rate in any_number(),
        damping in prop_oneof![0.0_f64..10.0, finite().prop_map(f64::abs)],
        stiffness in finite(),
        largest in finite().prop_map(f64::abs),
    ) {
        let force = share * largest;
        let result = damped(force, error_rate, damping, stiffness, largest);
        prop_assert!(result.abs() <= largest, "{result} N, limit {largest} N");
        // Signs, because a product of small numbers underflows and one of large numbers overflows.
        let added = result - force;
        prop_assert!(added == 0.0 || added.signum() == error_rate.signum(), "{added} N at {error_rate} m/s");
        if !error_rate.is_finite() {
            prop_assert_eq!(result, force);
        }
    }

    #[test]
    fn damped_within_limit_is_linear(
        force in -50.0_f64..50.0,
        error_rate in -0.2_f64..0.2,
        damping in 0.0_f64..2.0,
        stiffness in 0.0_f64..1e4,
    ) {
        let result = damped(force, error_rate, damping, stiffness, 100.0);
        let expected = force + damping * stiffness.sqrt() * error_rate;
        prop_assert!((result - expected).abs() <= 1e-12 * (1.0 + expected.abs()));
    }
}
