//! Rejection of numbers that are not finite, and of unknown codes.

use crate::draw::*;
use hapfic_controller::task_space::{self, TaskSpaceError, TaskSpaceInput, policies};
use hapfic_controller::{Attractor, ForceProfile, LowPass, limit};
use hapfic_messages::{ControllerState, MAX_JOINTS, Parameters, Saturation};

#[test]
fn task_space_number_not_finite_rejected() {
    let mut places = 0;
    loop {
        for bad in NOT_FINITE {
            let (mut state, mut input, mut p) = (ControllerState::default(), TaskSpaceInput::default(), ordinary());
            let Some(number) = place(places, &mut state, &mut input, &mut p) else {
                assert_eq!(places, 65);
                return;
            };
            *number = bad;
            let rejected = task_space::step(state, &input, &p, PERIOD_S);
            assert!(matches!(rejected, Err(TaskSpaceError::NotFinite { .. })), "place {places}: {rejected:?}");
        }
        places += 1;
    }
}

#[test]
fn task_space_error_overflow_rejected() {
    let input = TaskSpaceInput { position: [f64::MAX; 3], reference_position: [f64::MIN; 3], ..TaskSpaceInput::default() };
    let rejected = task_space::step(ControllerState::default(), &input, &ordinary(), PERIOD_S);
    assert_eq!(rejected, Err(TaskSpaceError::NotFinite { quantity: "error", index: 0, found: f64::NEG_INFINITY }));
}

#[test]
fn task_space_unknown_policy_or_period_rejected() {
    let step = |p: &Parameters, period_s| task_space::step(ControllerState::default(), &TaskSpaceInput::default(), p, period_s);
    let unknown = |quantity, last| Err(TaskSpaceError::UnknownPolicy { quantity, found: 7, last });
    let p = Parameters { reset_policy: 7, ..ordinary() };
    assert_eq!(step(&p, PERIOD_S), unknown("reset_policy", 2));
    assert_eq!(policies(&p), None);
    let p = Parameters { saturation: 7, ..ordinary() };
    assert_eq!(step(&p, PERIOD_S), unknown("saturation", 2));
    assert_eq!(policies(&p), None);
    let p = Parameters { search: 7, ..ordinary() };
    assert_eq!(step(&p, PERIOD_S), unknown("search", 2));
    assert_eq!(policies(&p), None);
    let p = Parameters { offset_anti_windup: 7, ..ordinary() };
    assert_eq!(step(&p, PERIOD_S), unknown("offset_anti_windup", 1));
    assert_eq!(policies(&p), None);
    let p = Parameters { stall_release: 7, ..ordinary() };
    assert_eq!(step(&p, PERIOD_S), unknown("stall_release", 1));
    assert_eq!(policies(&p), None);
    let p = Parameters { force_hold: 7, ..ordinary() };
    assert_eq!(step(&p, PERIOD_S), unknown("force_hold", 1));
    assert_eq!(policies(&p), None);
    let p = Parameters { continuous_reentry: 7, ..ordinary() };
    assert_eq!(step(&p, PERIOD_S), unknown("continuous_reentry", 1));
    assert_eq!(policies(&p), None);
    for period_s in [0.0, -PERIOD_S, f64::NAN, f64::INFINITY] {
        assert!(matches!(step(&ordinary(), period_s), Err(TaskSpaceError::Period { .. })));
    }
    assert!(step(&ordinary(), PERIOD_S).is_ok());
}

#[test]
fn laws_number_not_finite_gives_zero_force() {
    let profile = ForceProfile { stiffness: 1e3, max_force: 50.0, position_bound: 0.05, saturation: Saturation::Continuous };
    let before = Attractor { x_max_m: 0.02, converging: true };
    for bad in NOT_FINITE {
        assert_eq!(profile.force(bad), 0.0);
        assert_eq!(ForceProfile { stiffness: bad, ..profile }.force(0.01), 0.0);
        assert_eq!(ForceProfile { max_force: bad, ..profile }.force(0.01), 0.0);
        assert_eq!(ForceProfile { position_bound: bad, ..profile }.force(0.01), 0.0);
        assert_eq!(before.step(bad, 0.1, &profile), (before, 0.0));
        assert_eq!(before.step(0.01, bad, &profile), (before, 0.0));
        let after = Attractor { x_max_m: bad, converging: true }.step(0.01, -0.1, &profile);
        assert_eq!(after, (Attractor { x_max_m: 0.01, converging: true }, profile.force(0.01)));
    }
}

#[test]
fn low_pass_without_cutoff_passes_torque() {
    let filled = |values: [f64; 8]| {
        let mut all = [0.0; MAX_JOINTS];
        all[..8].copy_from_slice(&values);
        all
    };
    let torque = filled([1.0, -2.0, 3.0, 0.0, 5.5, -6.5, 7.0, 80.0]);
    let passed = LowPass::default().step(&torque, None, PERIOD_S);
    assert_eq!(passed.output, torque);
    // Switched on, the filter starts from the last torque.
    let filtered = passed.step(&torque, Some(20.0), PERIOD_S);
    for (output, torque) in filtered.output.iter().zip(torque) {
        assert!((output - torque).abs() <= 1e-12, "{output} instead of {torque}");
    }
    let (limited, bits) = limit(&torque, &filled([40.0, 1.0, 3.0, 0.0, f64::INFINITY, 6.5, f64::NAN, 40.0]));
    assert_eq!(limited, filled([1.0, -1.0, 3.0, 0.0, 5.5, -6.5, 0.0, 40.0]));
    assert_eq!(bits, 0b1100_0010);
}
