//! The adaptive taper.

use crate::draw::*;
use hapfic_controller::AdaptiveTaper;
use proptest::prelude::*;

/// Force errors of a contact: an oscillation about a decaying value, both of random size.
fn contact() -> impl Strategy<Value = Vec<f64>> {
    let wave = (-100.0_f64..100.0, 0.0_f64..200.0, 0.0_f64..50.0, 1.0_f64..200.0);
    (wave, 10_usize..400).prop_map(|((mean, rate, amplitude, period), ticks)| {
        (0..ticks)
            .map(|tick| {
                let t = tick as f64;
                mean * (-rate * t * PERIOD_S).exp() + amplitude * (core::f64::consts::TAU * t / period).cos()
            })
            .collect()
    })
}

/// Smallest taper after a state under F_d.
fn least(before: &AdaptiveTaper, desired: f64) -> f64 {
    if before.slow_error > 0.03 * desired.abs() { 0.012 } else { 0.015 }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn adaptive_taper_any_errors_within_range(
        errors in prop::collection::vec(any_number(), 1..100),
        desired in any_number(),
        most in any_number(),
        resolution in 0.0_f64..1.0,
    ) {
        let mut state = AdaptiveTaper::default();
        for error in errors {
            let before = state;
            state = state.step(desired, error, resolution, most, PERIOD_S);
            if error.is_finite() && most.is_finite() {
                prop_assert!((most.min(0.012)..=most).contains(&state.taper), "{state:?}, at most {most}");
            } else {
                prop_assert_eq!(state, before);
            }
        }
    }

    #[test]
    fn adaptive_taper_contact_halves_at_signs_and_grows_slowly(
        errors in contact(),
        desired in -200.0_f64..200.0,
        most in 0.05_f64..1.0,
    ) {
        const RESOLUTION: f64 = 0.01;
        let growth = (PERIOD_S / 0.05).exp();
        let (mut state, mut last) = (AdaptiveTaper::default(), 0.0);
        for error in errors {
            let before = state;
            state = state.step(desired, error, RESOLUTION, most, PERIOD_S);
            let least = least(&before, desired);
            prop_assert!((least..=most).contains(&state.taper));
            prop_assert!(state.taper <= before.taper.max(0.05) * growth * (1.0 + 1e-12), "{before:?}, {state:?}");
            if error.abs() < RESOLUTION {
                // The error has no sign, and the last one counts on.
                prop_assert_eq!(state.force_error, before.force_error);
                continue;
            }
            if before.taper > 0.0 {
                if last * error < 0.0 {
                    prop_assert_eq!(state.taper, (0.5 * before.taper).max(least));
                } else {
                    prop_assert!(state.taper >= before.taper.min(most), "{before:?}, {state:?} at {error} N");
                }
                if last * error > 0.0 && error.abs() >= state.slow_error {
                    // The error does not fall: the search is too slow, unless the error is small.
                    let factor = if error.abs() < 0.003 * desired.abs() { 1.0 } else { growth };
                    let grown = (before.taper * factor).clamp(least, most);
                    prop_assert!((state.taper - grown).abs() < 1e-12, "{before:?}, {state:?} at {error} N");
                }
            }
            last = error;
        }
    }

    #[test]
    fn adaptive_taper_decay_rate_decides_on_growth(size in 1.0_f64..100.0, rate in 1.0_f64..100.0) {
        // Far from the limit of 20 1/s, with the smoothed error settled; 150 ms leave an error beyond the resolution.
        prop_assume!((rate - 20.0).abs() > 4.0);
        let mut state = AdaptiveTaper::default();
        let mut before = state;
        for tick in 0..150 {
            before = state;
            state = state.step(1e-3, size * (-rate * PERIOD_S * f64::from(tick)).exp(), 1e-9, 1.0, PERIOD_S);
        }
        prop_assert_eq!(state.taper > before.taper, rate < 20.0, "{} 1/s: {} -> {}", rate, before.taper, state.taper);
    }
}
