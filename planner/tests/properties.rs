//! Properties of the planner for every sequence of targets, at any ticks and with changing limits.
#![allow(clippy::print_stdout)]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use core::f64::consts::PI;
use hapfic_messages::PlannerState;
use hapfic_planner::{PEAK_TO_MEAN, PlannerParameters, Setpoint, hold, setpoint, step};
use proptest::prelude::*;

const PERIOD_S: f64 = 1e-3;
/// Rounding of coordinates below 1 m over a hundred operations [m].
const ROUNDING: f64 = 1e-12;

/// A new target for some ticks, with its limits.
#[derive(Clone, Debug)]
struct Change {
    ticks: u32,
    /// Whether `point` is relative to the reference.
    relative: bool,
    /// Axes whose target changes.
    moved: [bool; 3],
    point: [f64; 3],
    limits: PlannerParameters,
}

impl Change {
    fn target(&self, state: &PlannerState) -> [f64; 3] {
        let here = setpoint(state, PERIOD_S).position_m;
        [0, 1, 2].map(|axis: usize| {
            if !self.moved[axis] {
                state.axes[axis].target
            } else if self.relative {
                here[axis] + self.point[axis]
            } else {
                self.point[axis]
            }
        })
    }
}

fn limits() -> impl Strategy<Value = PlannerParameters> {
    (0.02_f64..1.0, 1.0_f64..20.0).prop_map(|(mean_speed_m_per_s, max_acceleration_m_per_s2)| PlannerParameters {
        mean_speed_m_per_s,
        max_acceleration_m_per_s2,
    })
}

fn change() -> impl Strategy<Value = Change> {
    let ticks = prop_oneof![1_u32..4, 4_u32..400];
    let scale = prop_oneof![Just(1e-6), Just(1e-3), Just(0.05), Just(0.5)];
    let direction = prop::array::uniform3(-1.0_f64..1.0);
    (ticks, any::<bool>(), any::<[bool; 3]>(), scale, direction, limits()).prop_map(
        |(ticks, relative, moved, scale, direction, limits): (u32, bool, [bool; 3], f64, [f64; 3], PlannerParameters)| Change {
            ticks,
            relative,
            moved,
            point: direction.map(|x| x * scale),
            limits,
        },
    )
}

fn changes() -> impl Strategy<Value = Vec<Change>> {
    prop::collection::vec(change(), 1..12)
}

fn start() -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(-0.5_f64..0.5)
}

/// Returns states and setpoints of a run, tick by tick.
fn run(mut state: PlannerState, changes: &[Change]) -> Vec<(PlannerState, Setpoint)> {
    let mut ticks = Vec::new();
    for change in changes {
        let target = change.target(&state);
        for _ in 0..change.ticks {
            let (next, point) = step(state, target, &change.limits, PERIOD_S);
            state = next;
            ticks.push((state, point));
        }
    }
    ticks
}

fn bits(point: &Setpoint) -> [[u64; 3]; 2] {
    [point.position_m.map(f64::to_bits), point.velocity_m_per_s.map(f64::to_bits)]
}

/// Any number, with frequent special values.
fn special() -> impl Strategy<Value = f64> {
    prop_oneof![
        any::<f64>(),
        -1.0_f64..1.0,
        prop::sample::select(vec![0.0, -1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, 1e-320, 1e-160]),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 128, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn step_any_targets_continuous_within_limits(start in start(), changes in changes()) {
        let mut state = hold(start);
        let mut before = setpoint(&state, PERIOD_S);
        // Limits of the active plan: those of the last target that differed.
        let mut accepted = changes[0].limits;
        let mut speed_at_acceptance = [0.0_f64; 3];
        for change in &changes {
            let target = change.target(&state);
            if target != state.axes.map(|axis| axis.target) {
                accepted = change.limits;
                speed_at_acceptance = before.velocity_m_per_s.map(f64::abs);
            }
            let peak = PEAK_TO_MEAN * accepted.mean_speed_m_per_s;
            let acceleration = accepted.max_acceleration_m_per_s2 * (1.0 + 1e-6);
            let fastest = speed_at_acceptance.map(|speed| peak.max(speed) * (1.0 + 1e-9));
            for _ in 0..change.ticks {
                let (next, now) = step(state, target, &change.limits, PERIOD_S);
                for (axis, fastest) in fastest.into_iter().enumerate() {
                    let (x, v) = (before.position_m[axis], before.velocity_m_per_s[axis]);
                    let (next_x, next_v) = (now.position_m[axis], now.velocity_m_per_s[axis]);
                    prop_assert!(next_v.abs() <= fastest + ROUNDING, "speed {next_v}, allowed {fastest}");
                    prop_assert!((next_x - x).abs() <= fastest * PERIOD_S + ROUNDING, "jump from {x} to {next_x}");
                    let dv = (next_v - v).abs();
                    prop_assert!(dv <= acceleration * PERIOD_S + ROUNDING, "velocity from {v} to {next_v}");
                    // Position and velocity are consistent: |x(t + T) - x(t) - v T| <= a T^2 / 2.
                    let deviation = (next_x - x - v * PERIOD_S).abs();
                    let allowed = 0.5 * acceleration * PERIOD_S * PERIOD_S + ROUNDING;
                    prop_assert!(deviation <= allowed, "{next_x} does not follow from {x} at {v}");
                }
                state = next;
                before = now;
            }
        }
    }

    #[test]
    fn step_long_enough_rests_on_target(start in start(), changes in changes()) {
        let mut before = hold(start);
        for change in &changes {
            let target = change.target(&before);
            let fastest = setpoint(&before, PERIOD_S).velocity_m_per_s.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
            let here = setpoint(&before, PERIOD_S).position_m;
            let distance = target[0] - here[0];
            let distance = distance.hypot(target[1] - here[1]).hypot(target[2] - here[2]);
            let last = run(before, core::slice::from_ref(change)).pop().unwrap().0;
            if last.ticks == u64::from(change.ticks) {
                // The target is new. Braking takes u / a and adds a distance of u^2 / 2a; the arc takes at most pi d /
                // v_max, or the time that a_max allows.
                let (peak, a) = (PEAK_TO_MEAN * change.limits.mean_speed_m_per_s, change.limits.max_acceleration_m_per_s2);
                let farthest = distance + 0.5 * fastest * fastest / a;
                let longest = fastest / a + (PI * farthest / peak).max(PI * (0.5 * farthest / a).sqrt());
                let end = PlannerState { ticks: (longest / PERIOD_S) as u64 + 2, ..last };
                let at_rest = Setpoint { position_m: target, velocity_m_per_s: [0.0; 3] };
                prop_assert_eq!(setpoint(&end, PERIOD_S), at_rest);
                prop_assert_eq!(step(end, target, &change.limits, PERIOD_S).1, at_rest);
            }
            before = last;
        }
    }

    #[test]
    fn step_from_rest_path_straight(start in start(), target in start(), mean_speed_m_per_s in 0.02_f64..1.0) {
        let mut state = hold(start);
        let path = [0, 1, 2].map(|axis: usize| target[axis] - start[axis]);
        let length = path[0].hypot(path[1]).hypot(path[2]);
        // The path needs A_max = 2 v_max^2 / d: a larger a_max limits no axis.
        let needed = 2.0 * (PEAK_TO_MEAN * mean_speed_m_per_s).powi(2) / length;
        let limits = PlannerParameters { mean_speed_m_per_s, max_acceleration_m_per_s2: 1.01 * needed };
        for _ in 0..300 {
            let (next, now) = step(state, target, &limits, PERIOD_S);
            state = next;
            let done = [0, 1, 2].map(|axis: usize| now.position_m[axis] - start[axis]);
            for (i, j) in [(0, 1), (1, 2), (2, 0)] {
                let aside = (done[i] * path[j] - done[j] * path[i]).abs() / length;
                prop_assert!(aside <= ROUNDING, "{aside} m off the straight line");
            }
        }
    }

    #[test]
    fn state_copied_continues_same_bits(start in start(), changes in changes(), cut in any::<prop::sample::Index>()) {
        let cut = cut.index(changes.len());
        let whole = run(hold(start), &changes);
        let first = run(hold(start), &changes[..cut]);
        let copied = first.last().map_or(hold(start), |(state, _)| *state);
        // Another motion in between has no effect.
        let _ = run(hold([0.3, -0.2, 0.1]), &changes);
        let rest = run(copied, &changes[cut..]);
        prop_assert_eq!(first.len() + rest.len(), whole.len());
        for ((state, point), (expected_state, expected)) in rest.iter().zip(&whole[first.len()..]) {
            prop_assert_eq!(state, expected_state);
            prop_assert_eq!(bits(point), bits(expected));
            prop_assert_eq!(bits(&setpoint(state, PERIOD_S)), bits(point));
        }
    }

    #[test]
    fn step_any_number_output_finite(
        start in start(),
        inputs in prop::collection::vec((prop::array::uniform3(special()), special(), special(), special()), 1..40),
    ) {
        let mut state = hold(start);
        for (target, mean_speed_m_per_s, max_acceleration_m_per_s2, period_s) in inputs {
            let limits = PlannerParameters { mean_speed_m_per_s, max_acceleration_m_per_s2 };
            for period_s in [PERIOD_S, period_s] {
                let (next, now) = step(state, target, &limits, period_s);
                state = next;
                for value in now.position_m.iter().chain(&now.velocity_m_per_s) {
                    prop_assert!(value.is_finite(), "{now:?} from {state:?}");
                }
            }
        }
    }

    #[test]
    fn step_invalid_request_keeps_plan(start in start(), changes in changes(), axis in 0_usize..3, target in start()) {
        let (state, _) = *run(hold(start), &changes).last().unwrap();
        let limits = changes[0].limits;
        let (expected_state, expected) = step(state, state.axes.map(|plan| plan.target), &limits, PERIOD_S);
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX] {
            let mut bad_target = target;
            bad_target[axis] = bad;
            let (next, now) = step(state, bad_target, &limits, PERIOD_S);
            prop_assert_eq!(next, expected_state);
            prop_assert_eq!(bits(&now), bits(&expected));
        }
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -1.0] {
            for bad_limits in [
                PlannerParameters { mean_speed_m_per_s: bad, ..limits },
                PlannerParameters { max_acceleration_m_per_s2: bad, ..limits },
            ] {
                let (next, now) = step(state, target, &bad_limits, PERIOD_S);
                prop_assert_eq!(next, expected_state);
                prop_assert_eq!(bits(&now), bits(&expected));
            }
        }
    }

    #[test]
    fn limits_changed_apply_to_next_target(start in start(), target in start(), slow in limits(), fast in limits()) {
        let (state, _) = step(hold(start), target, &slow, PERIOD_S);
        let (expected_state, expected) = step(state, target, &slow, PERIOD_S);
        let (next, now) = step(state, target, &fast, PERIOD_S);
        prop_assert_eq!(next, expected_state);
        prop_assert_eq!(bits(&now), bits(&expected));
    }
}

#[test]
fn step_long_distance_takes_planned_time() {
    let limits = PlannerParameters { mean_speed_m_per_s: 0.5, max_acceleration_m_per_s2: 10.0 };
    let target = [1.0, 0.0, 0.0];
    let (mut state, mut fastest, mut ticks) = (hold([0.0; 3]), 0.0_f64, 0);
    loop {
        let (next, now) = step(state, target, &limits, PERIOD_S);
        state = next;
        ticks += 1;
        fastest = fastest.max(now.velocity_m_per_s[0]);
        if now.position_m == target || ticks > 10_000 {
            break;
        }
    }
    // pi d / (2 v_max) = pi / (2 * 1.596 * 0.5) = 1.9684 s: the reference arrives with the next tick.
    assert_eq!(ticks, 1969);
    assert!((fastest - 0.798).abs() < 1e-6, "{fastest}");
}

/// Pins the figures of docs/decisions/0005 for streamed targets.
#[test]
fn target_trembles_slows_reference() {
    let parameters = PlannerParameters { mean_speed_m_per_s: 0.5, max_acceleration_m_per_s2: 10.0 };
    let travel = |amplitude: f64| {
        let mut state = hapfic_planner::hold([0.0; 3]);
        let mut position = 0.0;
        for tick in 0..500 {
            let target = [0.1 + if tick % 2 == 0 { amplitude } else { -amplitude }, 0.0, 0.0];
            let (next, setpoint) = hapfic_planner::step(state, target, &parameters, 1e-3);
            (state, position) = (next, setpoint.position_m[0]);
        }
        position
    };
    println!(
        "travel after 0.5 s [m]: {} to a constant target, {} to a target that trembles by 0.1 mm",
        travel(0.0),
        travel(1e-4)
    );
    assert!((travel(0.0) - 0.1).abs() < 1e-12);
    assert!(travel(1e-4) < 0.05 && travel(1e-4) > 0.0);
}
