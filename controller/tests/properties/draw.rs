//! Strategies for inputs and parameters, and the work along a path of the error.

use hapfic_controller::task_space::TaskSpaceInput;
use hapfic_controller::{Attractor, ForceProfile, HapticParameters, Stall, StallInput};
use hapfic_messages::{ControllerState, Parameters, ResetPolicy, Saturation, Search};
use proptest::prelude::*;

/// T [s].
pub const PERIOD_S: f64 = 1e-3;
pub const NOT_FINITE: [f64; 3] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];

/// Any finite number of either sign: ordinary, huge, tiny or zero.
pub fn finite() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -1.0_f64..1.0,
        2 => -1e4_f64..1e4,
        2 => any::<f64>().prop_map(|x| if x.is_finite() { x } else { 1.0 }),
        1 => prop::sample::select(vec![0.0, -0.0, f64::MAX, f64::MIN, f64::MIN_POSITIVE, 5e-324, 1e-200, 1e200]),
    ]
}

/// Any finite parameter, mostly non-negative, so that most sets are valid.
pub fn parameter() -> impl Strategy<Value = f64> {
    prop_oneof![8 => finite().prop_map(f64::abs), 1 => finite()]
}

pub fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![3 => finite(), 1 => prop::sample::select(NOT_FINITE.to_vec())]
}

pub fn saturation() -> impl Strategy<Value = Saturation> {
    prop::sample::select(Saturation::ALL.to_vec())
}

pub fn profile() -> impl Strategy<Value = ForceProfile> {
    (parameter(), parameter(), parameter(), saturation()).prop_map(|(stiffness, max_force, position_bound, saturation)| {
        ForceProfile { stiffness, max_force, position_bound, saturation }
    })
}

pub fn haptic_parameters() -> impl Strategy<Value = HapticParameters> {
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

/// Forces and lengths whose differences do not overflow.
pub fn moderate() -> impl Strategy<Value = f64> {
    let scale = prop_oneof![4 => Just(1.0_f64), 2 => Just(1e4), 1 => Just(1e300), 1 => Just(1e-300), 1 => Just(0.0)];
    (scale, -1.0_f64..1.0).prop_map(|(scale, share)| scale * share)
}

pub fn input() -> impl Strategy<Value = TaskSpaceInput> {
    let vector = || prop::array::uniform3(moderate());
    (vector(), vector(), vector(), vector(), vector()).prop_map(
        |(position, velocity, reference_position, reference_velocity, contact_force)| TaskSpaceInput {
            position,
            velocity,
            reference_position,
            reference_velocity,
            contact_force,
        },
    )
}

pub fn parameters() -> impl Strategy<Value = Parameters> {
    let magnitudes = || prop::array::uniform3(moderate().prop_map(f64::abs));
    let gains = (magnitudes(), magnitudes(), magnitudes(), prop::array::uniform3(moderate()));
    // Every combination of policies, among them the defaults and the paper's.
    let policies = (0_u32..3, 0_u32..3, 0_u32..3, prop::array::uniform4(0_u32..2));
    let scalars = (0.0_f64..1.0, prop_oneof![Just(0.0), 0.0_f64..5.0], 0.0_f64..0.02, 0.0_f64..0.1, 0.0_f64..0.1);
    (gains, policies, scalars).prop_map(
        |((stiffness, max_force, position_bound, desired_force), policies, (taper, damping, lead, scale, resolution))| {
            let (reset_policy, saturation, search, [offset_anti_windup, stall_release, force_hold, continuous_reentry]) =
                policies;
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
                force_hold,
                continuous_reentry,
                taper,
                damping,
                posture_lead: lead,
                search_scale: scale,
                force_resolution: resolution,
                ..Parameters::default()
            }
        },
    )
}

/// Any valid state, as from another controller.
pub fn state() -> impl Strategy<Value = ControllerState> {
    let vector = || prop::array::uniform3(moderate());
    let magnitude = || prop::array::uniform3(moderate().prop_map(f64::abs));
    let ticks = prop::array::uniform3(prop_oneof![0_u32..40, Just(u32::MAX)]);
    let gains = (magnitude(), magnitude(), magnitude());
    let learnt = (prop::array::uniform3(0.0_f64..1.0), vector(), magnitude(), prop::array::uniform3(0.0_f64..1.0));
    ((vector(), vector(), vector(), vector()), gains, learnt, prop::array::uniform3(0_u32..2), ticks).prop_map(
        |((offset, x_max, force, x_max_force), gains, learnt, converging, at_rest_ticks)| {
            let (stiffness, max_force, position_bound) = gains;
            let (taper, force_error, slow_error, free_time) = learnt;
            ControllerState {
                offset,
                x_max,
                stiffness,
                max_force,
                position_bound,
                force,
                taper,
                force_error,
                slow_error,
                free_time,
                x_max_force,
                converging,
                at_rest_ticks,
            }
        },
    )
}

/// Parameters with all improvements.
pub fn improved(p: Parameters) -> Parameters {
    Parameters {
        saturation: Saturation::Softening.code(),
        search: Search::Adaptive.code(),
        offset_anti_windup: 1,
        stall_release: 1,
        force_hold: 1,
        continuous_reentry: 1,
        damping: 0.5,
        ..p
    }
}

/// Ordinary parameter set.
pub fn ordinary() -> Parameters {
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

/// Returns the n-th number that enters the task-space law; `None` after the last.
pub fn place<'a>(
    n: usize,
    state: &'a mut ControllerState,
    input: &'a mut TaskSpaceInput,
    p: &'a mut Parameters,
) -> Option<&'a mut f64> {
    let search = state.offset.iter_mut().chain(&mut state.x_max);
    let before = state.stiffness.iter_mut().chain(&mut state.max_force).chain(&mut state.position_bound).chain(&mut state.force);
    let learnt = state.taper.iter_mut().chain(&mut state.force_error).chain(&mut state.slow_error).chain(&mut state.free_time);
    let state = search.chain(before).chain(learnt).chain(&mut state.x_max_force);
    let motion = input.position.iter_mut().chain(&mut input.velocity);
    let reference = input.reference_position.iter_mut().chain(&mut input.reference_velocity);
    let gains = p.stiffness.iter_mut().chain(&mut p.max_force).chain(&mut p.position_bound);
    let forces = input.contact_force.iter_mut().chain(&mut p.desired_force);
    let scalars = [&mut p.taper, &mut p.search_scale, &mut p.force_resolution, &mut p.damping, &mut p.posture_lead];
    state.chain(motion).chain(reference).chain(gains).chain(forces).chain(scalars).nth(n)
}

/// A closed path of the error: knots in shares of x_b, back to the first one.
pub fn cycle() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-2.0_f64..2.0, 2..9).prop_map(|mut knots| {
        knots.push(knots[0]);
        knots
    })
}

/// Monotone segments between knots, divided at zero error, where the attractor's force is discontinuous.
pub fn segments(knots: &[f64]) -> Vec<(f64, f64)> {
    let mut segments = Vec::new();
    for pair in knots.windows(2) {
        let (from, to) = (pair[0], pair[1]);
        if from * to < 0.0 {
            segments.extend([(from, 0.0), (0.0, to)]);
        } else {
            segments.push((from, to));
        }
    }
    segments
}

/// Samples per segment.
pub const SAMPLES: u32 = 64;

/// Work of a force on the robot along a path of the error [J]: -sum F de, with the force at the midpoint of each
/// sample.
pub fn work(segments: &[(f64, f64)], mut force: impl FnMut(f64, f64) -> f64) -> f64 {
    let mut work = 0.0;
    for &(from, to) in segments {
        let sample = (to - from) / f64::from(SAMPLES);
        for i in 0..SAMPLES {
            let error = from + (f64::from(i) + 0.5) * sample;
            work -= force(error, sample / PERIOD_S) * sample;
        }
    }
    work
}

/// Runs one tick of an axis with release: the attractor's step, then the stall's, without contact, resolution 0.01 N.
pub fn released(state: (Attractor, Stall), error: f64, error_rate: f64, profile: &ForceProfile) -> ((Attractor, Stall), f64) {
    let (attractor, force) = state.0.step(error, error_rate, profile);
    let stall_input = StallInput { error, error_rate, force, contact_force: 0.0, force_resolution: 0.01, period_s: PERIOD_S };
    let (stall, attractor, force) = state.1.step(attractor, &stall_input, profile);
    ((attractor, stall), force)
}

/// Ticks at rest that suffice for a release.
pub const PAUSE: u32 = 25;

/// Work as in [`work`] of the law with release, along a path with a pause after every segment [J].
pub fn work_with_pauses(segments: &[(f64, f64)], profile: &ForceProfile) -> f64 {
    let mut state = (Attractor::default(), Stall::default());
    let mut work = 0.0;
    for &(from, to) in segments {
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

/// Largest apparent energy gain from sampling [J].
///
/// The midpoint rule is exact where the force is linear. Where the profile bends it overestimates the stored energy,
/// which is the safe side. The law detects a convergence from M half a sample h late, at M - h/2. With F_c(e) / e
/// falling, its work is at most `F_c/|x_max| (-(M - m)^2 / 2 + (M - m) h / 2 + h^2 / 8)` more than the energy released
/// between M and m. That is largest, h^2/4, at M - m = h/2; and F_c/|x_max| <= K0. The last term is rounding.
pub fn sampling_error(segments: &[(f64, f64)], profile: &ForceProfile) -> f64 {
    let squares: f64 = segments.iter().map(|(from, to)| ((to - from) / f64::from(SAMPLES)).powi(2)).sum();
    let length: f64 = segments.iter().map(|(from, to)| (to - from).abs()).sum();
    0.25 * profile.stiffness * squares + 1e-12 * profile.max_force * length
}

/// A softening profile from ordinary gains: K0, x_b and F_max / (K0 x_b).
pub fn softening() -> impl Strategy<Value = ForceProfile> {
    (1.0_f64..5.0, -3.0_f64..-1.0, 0.05_f64..0.95, saturation()).prop_map(|(stiffness, bound, share, saturation)| {
        let (stiffness, position_bound) = (10_f64.powf(stiffness), 10_f64.powf(bound));
        ForceProfile { stiffness, max_force: share * stiffness * position_bound, position_bound, saturation }
    })
}
