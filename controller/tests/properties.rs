//! What the laws promise for every input and every parameter set.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use hapfic_controller::task_space::{self, Input, TaskSpaceError, policies};
use hapfic_controller::{
    Attractor, ForceProfile, HapticParameters, HapticSearch, LowPass, Stall, StallInput, held_back, limit, refitted,
};
use hapfic_ipc::message::{ControllerState, MAX_JOINTS, Parameters, ResetPolicy, Saturation, Search};
use proptest::prelude::*;

const PERIOD_S: f64 = 1e-3;
const NOT_FINITE: [f64; 3] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];

/// Any finite number: ordinary, huge, tiny, zero, of both signs.
fn finite() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -1.0_f64..1.0,
        2 => -1e4_f64..1e4,
        2 => any::<f64>().prop_map(|x| if x.is_finite() { x } else { 1.0 }),
        1 => prop::sample::select(vec![0.0, -0.0, f64::MAX, f64::MIN, f64::MIN_POSITIVE, 5e-324, 1e-200, 1e200]),
    ]
}

/// Any finite parameter; mostly of the right sign, so that most sets are usable.
fn parameter() -> impl Strategy<Value = f64> {
    prop_oneof![8 => finite().prop_map(f64::abs), 1 => finite()]
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![3 => finite(), 1 => prop::sample::select(NOT_FINITE.to_vec())]
}

fn saturation() -> impl Strategy<Value = Saturation> {
    prop::sample::select(Saturation::ALL.to_vec())
}

fn profile() -> impl Strategy<Value = ForceProfile> {
    (parameter(), parameter(), parameter(), saturation()).prop_map(|(stiffness, max_force, position_bound, saturation)| {
        ForceProfile { stiffness, max_force, position_bound, saturation }
    })
}

fn haptic_parameters() -> impl Strategy<Value = HapticParameters> {
    let policies = (prop::sample::select(Search::ALL.to_vec()), prop::sample::select(ResetPolicy::ALL.to_vec()));
    (parameter(), parameter(), policies, parameter(), parameter(), parameter()).prop_map(
        |(stiffness, position_bound, (search, reset_policy), taper, search_scale, force_resolution)| HapticParameters {
            stiffness,
            position_bound,
            search,
            reset_policy,
            taper,
            search_scale,
            force_resolution,
            period_s: PERIOD_S,
        },
    )
}

/// Forces and lengths that do not overflow in a difference, but are otherwise anything.
fn moderate() -> impl Strategy<Value = f64> {
    let scale = prop_oneof![4 => Just(1.0_f64), 2 => Just(1e4), 1 => Just(1e300), 1 => Just(1e-300), 1 => Just(0.0)];
    (scale, -1.0_f64..1.0).prop_map(|(scale, share)| scale * share)
}

fn input() -> impl Strategy<Value = Input> {
    let vector = || prop::array::uniform3(moderate());
    (vector(), vector(), vector(), vector(), vector()).prop_map(
        |(position, velocity, reference_position, reference_velocity, contact_force)| Input {
            position,
            velocity,
            reference_position,
            reference_velocity,
            contact_force,
        },
    )
}

fn parameters() -> impl Strategy<Value = Parameters> {
    let magnitudes = || prop::array::uniform3(moderate().prop_map(f64::abs));
    let gains = (magnitudes(), magnitudes(), magnitudes(), prop::array::uniform3(moderate()));
    // Default and paper's policies, and every other combination.
    let policies = (0_u32..3, 0_u32..2, 0_u32..2, 0_u32..2, 0_u32..2);
    (gains, policies, 0.0_f64..1.0, 0.0_f64..0.1, 0.0_f64..0.1).prop_map(
        |((stiffness, max_force, position_bound, desired_force), policies, taper, scale, resolution)| {
            let (reset_policy, saturation, search, offset_anti_windup, stall_release) = policies;
            Parameters {
                desired_force,
                stiffness,
                max_force,
                position_bound,
                reset_policy,
                saturation,
                search,
                offset_anti_windup,
                stall_release,
                taper,
                search_scale: scale,
                force_resolution: resolution,
                ..Parameters::default()
            }
        },
    )
}

/// A parameter set as an operator would give it.
fn ordinary() -> Parameters {
    Parameters {
        desired_force: [0.0, 5.0, -20.0],
        stiffness: [2000.0; 3],
        max_force: [100.0; 3],
        position_bound: [0.05; 3],
        taper: 0.2,
        search_scale: 0.01,
        force_resolution: 0.01,
        ..Parameters::default()
    }
}

/// The n-th number that enters the task-space law; `None` behind the last.
fn place<'a>(n: usize, state: &'a mut ControllerState, input: &'a mut Input, p: &'a mut Parameters) -> Option<&'a mut f64> {
    let search = state.offset.iter_mut().chain(&mut state.x_max);
    let before = state.stiffness.iter_mut().chain(&mut state.max_force).chain(&mut state.position_bound).chain(&mut state.force);
    let state = search.chain(before);
    let motion = input.position.iter_mut().chain(&mut input.velocity);
    let reference = input.reference_position.iter_mut().chain(&mut input.reference_velocity);
    let gains = p.stiffness.iter_mut().chain(&mut p.max_force).chain(&mut p.position_bound);
    let forces = input.contact_force.iter_mut().chain(&mut p.desired_force);
    let scalars = [&mut p.taper, &mut p.search_scale, &mut p.force_resolution];
    state.chain(motion).chain(reference).chain(gains).chain(forces).chain(scalars).nth(n)
}

/// A closed path of the error: knots in shares of x_b, back to the first one.
fn cycle() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-2.0_f64..2.0, 2..9).prop_map(|mut knots| {
        knots.push(knots[0]);
        knots
    })
}

/// The monotone stretches between knots, divided at zero error, where the attractor's force changes at once.
fn stretches(knots: &[f64]) -> Vec<(f64, f64)> {
    let mut stretches = Vec::new();
    for pair in knots.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        if from * to < 0.0 {
            stretches.extend([(from, 0.0), (0.0, to)]);
        } else {
            stretches.push((from, to));
        }
    }
    stretches
}

/// Samples per stretch.
const SAMPLES: u32 = 64;

/// Work of a force on the robot along a path of the error, J: -sum F de, with the force at the middle of each sample.
fn work(stretches: &[(f64, f64)], mut force: impl FnMut(f64, f64) -> f64) -> f64 {
    let mut work = 0.0;
    for &(from, to) in stretches {
        let sample = (to - from) / f64::from(SAMPLES);
        for i in 0..SAMPLES {
            let error = from + (f64::from(i) + 0.5) * sample;
            work -= force(error, sample / PERIOD_S) * sample;
        }
    }
    work
}

/// One tick of an axis with release: the attractor's step, then the stall's. No contact, 0.01 N resolution.
fn released(state: (Attractor, Stall), error: f64, error_rate: f64, profile: &ForceProfile) -> ((Attractor, Stall), f64) {
    let (attractor, force) = state.0.step(error, error_rate, profile);
    let seen = StallInput { error, error_rate, force, contact_force: 0.0, force_resolution: 0.01, period_s: PERIOD_S };
    let (stall, attractor, force) = state.1.step(attractor, &seen, profile);
    ((attractor, stall), force)
}

/// Ticks of standing still that are enough for a release.
const PAUSE: u32 = 25;

/// Work as [`work`] counts it of the law with release, along a path with a pause behind every stretch.
fn work_with_pauses(stretches: &[(f64, f64)], profile: &ForceProfile) -> f64 {
    let mut state = (Attractor::default(), Stall::default());
    let mut work = 0.0;
    for &(from, to) in stretches {
        let sample = (to - from) / f64::from(SAMPLES);
        for i in 0..SAMPLES {
            let error = from + (f64::from(i) + 0.5) * sample;
            let (next, force) = released(state, error, sample / PERIOD_S, profile);
            state = next;
            work -= force * sample;
        }
        for _ in 0..PAUSE {
            state = released(state, to, 0.0, profile).0;
        }
    }
    work
}

/// What sampling can feign at most, J.
///
/// The middle rule is exact where the force is linear and stores too much where the profile bends, which is the safe side.
/// What remains: a convergence from M is noticed half a sample h late, at M - h/2. With F_c(e) / e falling, its work is
/// then at most `F_c/|x_max| (-(M - m)^2 / 2 + (M - m) h / 2 + h^2 / 8)` more than the energy released between M and m,
/// which is largest, h^2/4, at M - m = h/2; and F_c/|x_max| <= K0. The last term is rounding.
fn sampling_error(stretches: &[(f64, f64)], profile: &ForceProfile) -> f64 {
    let squares: f64 = stretches.iter().map(|(from, to)| ((to - from) / f64::from(SAMPLES)).powi(2)).sum();
    let length: f64 = stretches.iter().map(|(from, to)| (to - from).abs()).sum();
    0.25 * profile.stiffness * squares + 1e-12 * profile.max_force * length
}

/// A profile that does not harden, from ordinary gains: K0, x_b and F_max / (K0 x_b).
fn softening() -> impl Strategy<Value = ForceProfile> {
    (1.0_f64..5.0, -3.0_f64..-1.0, 0.05_f64..0.95, saturation()).prop_map(|(stiffness, bound, share, saturation)| {
        let (stiffness, position_bound) = (10_f64.powf(stiffness), 10_f64.powf(bound));
        ForceProfile { stiffness, max_force: share * stiffness * position_bound, position_bound, saturation }
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn profile_stays_within_f_max(profile in profile(), error in any_number()) {
        let force = profile.force(error);
        prop_assert!(force.abs() <= profile.max_force.max(0.0), "{force} N");
        prop_assert_eq!(profile.force(-error), -force);
    }

    #[test]
    fn profile_pulls_towards_the_reference(profile in softening(), error in -0.2_f64..0.2) {
        let force = profile.force(error);
        prop_assert!(force * error >= 0.0);
        prop_assert!((force - (profile.stiffness * error).clamp(-profile.max_force, profile.max_force)).abs()
            <= 1e-12 * profile.max_force);
    }

    #[test]
    fn attractor_stays_within_f_max(steps in prop::collection::vec((any_number(), any_number(), profile()), 1..60)) {
        let mut state = Attractor::default();
        for (error, error_rate, profile) in steps {
            let (next, force) = state.step(error, error_rate, &profile);
            prop_assert!(force.abs() <= profile.max_force.max(0.0), "{force} N from {state:?} at {error}, {error_rate}");
            prop_assert!(next.x_max_m.is_finite());
            state = next;
        }
    }

    #[test]
    fn offset_stays_within_its_bound(
        steps in prop::collection::vec((any_number(), any_number(), haptic_parameters()), 1..60),
    ) {
        let mut state = HapticSearch::default();
        for (desired, measured, p) in steps {
            state = state.step(desired, measured, &p);
            prop_assert!(state.offset_m.abs() <= p.position_bound.max(0.0), "{state:?} with {p:?}");
        }
    }

    #[test]
    fn offset_moves_at_most_a_full_step_towards_the_force(
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
        // More reaction along +x is had by reaching towards -x, whatever the sign of F_d.
        prop_assert!(moved * (desired - measured) < 0.0);
        let full = 0.01 * desired.abs() / 2000.0 * (period_s / 1e-3);
        prop_assert!(moved.abs() <= full * (1.0 + 1e-9) + 1e-15, "moved {moved}, full step {full}");
    }

    #[test]
    fn task_space_force_stays_within_f_max(steps in prop::collection::vec((input(), parameters()), 1..30)) {
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
    fn no_energy_is_gained_over_a_closed_cycle(profile in softening(), knots in cycle()) {
        let knots: Vec<f64> = knots.iter().map(|share| share * profile.position_bound).collect();
        let stretches = stretches(&knots);
        let mut state = Attractor::default();
        let gained = work(&stretches, |error, error_rate| {
            let (next, force) = state.step(error, error_rate, &profile);
            state = next;
            force
        });
        let allowed = sampling_error(&stretches, &profile);
        prop_assert!(gained <= allowed, "gained {gained} J, sampling explains {allowed} J");

        // The account is sharp enough: a tenth more on the way back than on the way out would show.
        let generous = work(&stretches, |error, error_rate| {
            profile.force(error) * if error * error_rate < 0.0 { 1.1 } else { 1.0 }
        });
        prop_assert!(generous > allowed, "a law that gives energy gained {generous} J and passed");
    }

    #[test]
    fn no_energy_is_gained_over_a_closed_cycle_with_releases(profile in softening(), knots in cycle()) {
        let knots: Vec<f64> = knots.iter().map(|share| share * profile.position_bound).collect();
        let stretches = stretches(&knots);
        let gained = work_with_pauses(&stretches, &profile);
        let allowed = sampling_error(&stretches, &profile);
        prop_assert!(gained <= allowed, "gained {gained} J, sampling explains {allowed} J");
    }

    #[test]
    fn a_release_offers_less_than_the_one_before(
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
            // Released if it pays, and then to no more than the profile and with no more to come than before.
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
    fn both_improvements_keep_every_bound(
        steps in prop::collection::vec((input(), parameters(), any::<u32>(), prop::array::uniform3(moderate())), 1..30),
    ) {
        let mut state = ControllerState::default();
        for (input, p, still, offset) in steps {
            let p = Parameters { offset_anti_windup: 1, stall_release: 1, ..p };
            // As if from another controller: any state that passes the checks.
            let from = ControllerState { still_ticks: [still, 0, u32::MAX], offset, ..state };
            let output = task_space::step(from, &input, &p, PERIOD_S);
            prop_assert!(output.is_ok(), "{output:?}");
            let output = output.unwrap();
            for axis in 0..3 {
                prop_assert!(output.force[axis].abs() <= p.max_force[axis], "{output:?} with {p:?}");
                prop_assert!(output.state.offset[axis].abs() <= p.position_bound[axis], "{output:?} with {p:?}");
                prop_assert_eq!(output.state.stiffness[axis], p.stiffness[axis]);
            }
            state = output.state;
        }
    }

    #[test]
    fn a_saturated_offset_moves_only_out_of_saturation_or_towards_zero(
        before in -0.02_f64..0.02,
        wanted in -0.02_f64..0.02,
        force in -1.0_f64..1.0,
        max_force in 0.1_f64..2.0,
    ) {
        let force = force.clamp(-max_force, max_force);
        let taken = held_back(before, wanted, force, max_force);
        prop_assert!(taken == before || taken == wanted);
        let deeper = (taken - before) * force > 0.0 && taken.abs() > before.abs();
        prop_assert!(!(deeper && force.abs() >= 0.999 * max_force), "{before} -> {taken} at {force} of {max_force} N");
        if force.abs() < 0.999 * max_force || (wanted - before) * force <= 0.0 || wanted.abs() <= before.abs() {
            prop_assert_eq!(taken, wanted);
        }
    }

    #[test]
    fn a_refitted_offset_stays_within_its_bound(
        distance in finite(),
        force in finite(),
        stiffness in parameter(),
        max_force in parameter(),
        position_bound in parameter(),
    ) {
        let profile = ForceProfile { stiffness, max_force, position_bound, saturation: Saturation::Continuous };
        let offset = refitted(distance, force, &profile);
        prop_assert!(offset.abs() <= position_bound.max(0.0), "{offset}");
    }

    #[test]
    fn a_refitted_offset_gives_the_force_that_was(
        distance in -0.1_f64..0.1,
        force in -300.0_f64..300.0,
        stiffness in 1.0_f64..1e5,
        max_force in 1.0_f64..400.0,
        position_bound in 1e-4_f64..1.0,
    ) {
        let profile = ForceProfile { stiffness, max_force, position_bound, saturation: Saturation::Continuous };
        let offset = refitted(distance, force, &profile);
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
    fn the_way_back_gives_back_nothing(
        profile in softening(),
        hardening in 0.1_f64..20.0,
        farthest in prop_oneof![-2.0_f64..-0.01, 0.01_f64..2.0],
    ) {
        // Holds for every profile, also one that hardens.
        let profile = ForceProfile { max_force: profile.max_force * hardening, ..profile };
        let farthest = farthest * profile.position_bound;
        let mut state = Attractor::default();
        let returned = work(&[(farthest, 0.0)], |error, error_rate| {
            let (next, force) = state.step(error, error_rate, &profile);
            state = next;
            force
        });
        // Noticed half a sample late: F_c |M| / |x_max| h / 2, and |M| < 2 |x_max|.
        let allowed = profile.force(farthest.abs()) * farthest.abs() / f64::from(SAMPLES);
        prop_assert!(returned.abs() <= allowed, "returned {returned} J, sampling explains {allowed} J");
    }

    #[test]
    fn low_pass_stays_within_its_inputs(
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

#[test]
fn a_number_that_is_not_finite_is_refused_wherever_it_comes_in() {
    let mut places = 0;
    loop {
        for bad in NOT_FINITE {
            let (mut state, mut input, mut p) = (ControllerState::default(), Input::default(), ordinary());
            let Some(number) = place(places, &mut state, &mut input, &mut p) else {
                assert_eq!(places, 48);
                return;
            };
            *number = bad;
            let refused = task_space::step(state, &input, &p, PERIOD_S);
            assert!(matches!(refused, Err(TaskSpaceError::NotFinite { .. })), "place {places}: {refused:?}");
        }
        places += 1;
    }
}

#[test]
fn an_error_that_overflows_is_refused() {
    let input = Input { position: [f64::MAX; 3], reference_position: [f64::MIN; 3], ..Input::default() };
    let refused = task_space::step(ControllerState::default(), &input, &ordinary(), PERIOD_S);
    assert_eq!(refused, Err(TaskSpaceError::NotFinite { quantity: "error", index: 0, found: f64::NEG_INFINITY }));
}

#[test]
fn unknown_policies_and_periods_are_refused() {
    let step = |p: &Parameters, period_s| task_space::step(ControllerState::default(), &Input::default(), p, period_s);
    let unknown = |quantity, last| Err(TaskSpaceError::UnknownPolicy { quantity, found: 7, last });
    let p = Parameters { reset_policy: 7, ..ordinary() };
    assert_eq!(step(&p, PERIOD_S), unknown("reset_policy", 2));
    assert_eq!(policies(&p), None);
    let p = Parameters { saturation: 7, ..ordinary() };
    assert_eq!(step(&p, PERIOD_S), unknown("saturation", 1));
    assert_eq!(policies(&p), None);
    let p = Parameters { search: 7, ..ordinary() };
    assert_eq!(step(&p, PERIOD_S), unknown("search", 1));
    assert_eq!(policies(&p), None);
    let p = Parameters { offset_anti_windup: 7, ..ordinary() };
    assert_eq!(step(&p, PERIOD_S), unknown("offset_anti_windup", 1));
    assert_eq!(policies(&p), None);
    let p = Parameters { stall_release: 7, ..ordinary() };
    assert_eq!(step(&p, PERIOD_S), unknown("stall_release", 1));
    assert_eq!(policies(&p), None);
    for period_s in [0.0, -PERIOD_S, f64::NAN, f64::INFINITY] {
        assert!(matches!(step(&ordinary(), period_s), Err(TaskSpaceError::Period { .. })));
    }
    assert!(step(&ordinary(), PERIOD_S).is_ok());
}

#[test]
fn a_non_finite_number_gives_no_force_and_moves_no_offset() {
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
fn without_a_cut_off_the_torque_passes_and_the_state_follows() {
    let torque = [1.0, -2.0, 3.0, 0.0, 5.5, -6.5, 7.0, 80.0];
    let passed = LowPass::default().step(&torque, None, PERIOD_S);
    assert_eq!(passed.output, torque);
    // Switched on, it starts from there.
    let filtered = passed.step(&torque, Some(20.0), PERIOD_S);
    for (output, torque) in filtered.output.iter().zip(torque) {
        assert!((output - torque).abs() <= 1e-12, "{output} instead of {torque}");
    }
    let (limited, bits) = limit(&torque, &[40.0, 1.0, 3.0, 0.0, f64::INFINITY, 6.5, f64::NAN, 40.0]);
    assert_eq!(limited, [1.0, -1.0, 3.0, 0.0, 5.5, -6.5, 0.0, 40.0]);
    assert_eq!(bits, 0b1100_0010);
}
