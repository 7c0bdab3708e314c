//! Metrics of synthetic runs with known results.

mod moments;

use hapfic_log::{Metrics, MetricsSummary, proto};

const Z: usize = 2;

fn state(tick: i64, position: [f64; 3], force_z: f64) -> proto::State {
    proto::State { tick, foot_position: position.to_vec(), foot_force: vec![0.0, 0.0, force_z], ..proto::State::default() }
}

fn reference(tick: i64, speed: f64) -> proto::Reference {
    proto::Reference { tick, position: vec![0.0; 3], velocity: vec![speed, 0.0, 0.0], ..proto::Reference::default() }
}

fn command(tick: i64, force: [f64; 3], mode: &str, source: &str) -> proto::Command {
    proto::Command { tick, force: force.to_vec(), mode: mode.into(), source: source.into(), ..proto::Command::default() }
}

fn operator(version: u64, effective_tick: i64, desired_z: f64) -> proto::Operator {
    proto::Operator {
        version,
        effective_tick,
        desired_force: vec![0.0, 0.0, desired_z],
        max_force: vec![150.0, 150.0, 300.0],
        position_bound: vec![0.002, 0.025, 0.025],
        force_resolution: 0.01,
        ..proto::Operator::default()
    }
}

/// Run with a given contact force and reference speed at each tick.
fn run(sets: &[proto::Operator], ticks: i64, force: impl Fn(i64) -> f64, speed: impl Fn(i64) -> f64) -> MetricsSummary {
    let mut metrics = Metrics::new();
    sets.iter().for_each(|set| metrics.push_operator(set));
    for tick in 0..ticks {
        metrics.push_state(&state(tick, [0.0; 3], force(tick)));
        metrics.push_reference(&reference(tick, speed(tick)));
        metrics.push_command(&command(tick, [0.0; 3], "active", "fresh"));
    }
    metrics.summary()
}

fn assert_close(found: Option<f64>, expected: f64) {
    assert!(found.is_some_and(|found| (found - expected).abs() < 1e-9), "found {found:?}, expected {expected}");
}

#[test]
fn force_settled_counts_half_second_after_change() {
    let force = run(&[operator(1, 0, 50.0)], 2000, |tick| if tick < 500 { 50.0 } else { 50.5 }, |_| 0.0).force;
    assert_close(force.settled_rms_n[Z], 0.5);
    assert_close(force.settled_rms_percent[Z], 1.0);
    assert_eq!(force.settled_ticks, [0, 0, 1500]);
    assert_eq!(force.desired_n, [None, None, Some(50.0)]);
    assert_eq!((force.settled_rms_n[0], force.settled_rms_n[1]), (None, None), "no desired force there");
    assert_eq!((force.sliding_rms_percent[Z], force.sliding_ticks[Z]), (None, 0));
}

#[test]
fn force_pull_counts_as_push() {
    let force = run(&[operator(1, 0, -50.0)], 600, |tick| if tick == 0 { -50.0 } else { -49.0 }, |_| 0.0).force;
    assert_close(force.settled_rms_percent[Z], 2.0);
    assert_eq!(force.settled_ticks[Z], 100);
}

#[test]
fn force_never_reached_is_not_settled() {
    let force = run(&[operator(1, 0, 50.0)], 2000, |_| 49.4, |_| 0.0).force;
    assert_eq!((force.settled_rms_n[Z], force.settled_ticks[Z]), (None, 0));
    assert_eq!(force.desired_n[Z], Some(50.0));
    assert_eq!(force.not_reached, [0, 0, 1]);
    assert_close(force.not_reached_error_n[Z], -0.6);
    // Within 1 % the force counts as reached.
    let force = run(&[operator(1, 0, 50.0)], 2000, |_| 49.6, |_| 0.0).force;
    assert_eq!(force.settled_ticks[Z], 1500);
    assert_eq!((force.not_reached[Z], force.not_reached_error_n[Z]), (0, None));
}

#[test]
fn force_not_reached_is_that_of_worst_segment() {
    // The last change has not had its half second.
    let sets = [operator(1, 0, 50.0), operator(2, 1000, 80.0), operator(3, 2000, -30.0), operator(4, 3000, 90.0)];
    let contact = |tick: i64| if tick < 1000 { 50.0 } else { 20.0 };
    let force = run(&sets, 3400, contact, |_| 0.0).force;
    assert_eq!(force.not_reached, [0, 0, 2]);
    assert_close(force.not_reached_error_n[Z], -60.0);
    assert_eq!(run(&[operator(1, 0, 50.0)], 500, contact, |_| 0.0).force.not_reached[Z], 0);
}

#[test]
fn force_new_target_restarts_settling() {
    let sets = [operator(1, 0, 50.0), operator(2, 1000, 80.0)];
    let contact = |tick: i64| match tick {
        ..1000 => 50.0,
        1000..1800 => 60.0,
        1800 => 80.0,
        _ => 80.8,
    };
    let force = run(&sets, 2000, contact, |_| 0.0).force;
    // 500 exact ticks of 50 N, one exact tick of 80 N, 199 ticks with an error of 0.8 N.
    assert_eq!(force.settled_ticks[Z], 700);
    assert_close(force.settled_rms_n[Z], (0.64 * 199.0 / 700.0_f64).sqrt());
    assert_close(force.settled_rms_percent[Z], (199.0 / 700.0_f64).sqrt());
    assert_eq!(force.desired_n[Z], Some(80.0));
}

#[test]
fn force_unrelated_parameter_change_keeps_settling() {
    let sets = [operator(1, 0, 50.0), operator(2, 1000, 50.0)];
    assert_eq!(run(&sets, 2000, |_| 50.0, |_| 0.0).force.settled_ticks[Z], 1500);
}

#[test]
fn force_sliding_is_separate_and_restarts_settling() {
    let slides = |tick: i64| (1000..1500).contains(&tick);
    let contact = |tick| if slides(tick) { 52.0 } else { 50.0 };
    let speed = |tick| if slides(tick) { 0.1 } else { 0.0 };
    let force = run(&[operator(1, 0, 50.0)], 2500, contact, speed).force;
    assert_close(force.sliding_rms_percent[Z], 4.0);
    assert_eq!(force.sliding_ticks[Z], 500);
    // 500 to 999 and 2000 to 2499.
    assert_eq!(force.settled_ticks[Z], 1000);
    assert_close(force.settled_rms_n[Z], 0.0);
}

#[test]
fn tracking_uses_bound_in_force() {
    let mut metrics = Metrics::new();
    metrics.push_operator(&operator(1, 0, 0.0));
    for tick in 0..100 {
        let x = if tick % 2 == 0 { 0.003 } else { -0.001 };
        metrics.push_state(&state(tick, [x, 0.0, 0.01], 0.0));
        metrics.push_reference(&reference(tick, 0.0));
    }
    let tracking = metrics.summary().tracking;
    assert_eq!(tracking.max_m, [0.003, 0.0, 0.01]);
    assert_close(Some(tracking.rms_m[0]), 5e-6_f64.sqrt());
    assert_eq!(tracking.bound_m, [0.002, 0.025, 0.025]);
    assert_eq!(tracking.outside_ticks, 50);
    assert_eq!(tracking.max_ratio, [0.003 / 0.002, 0.0, 0.01 / 0.025]);
    assert_close(Some(tracking.rms_ratio[2]), 0.4);
    assert_eq!(tracking.outside.ticks, [50, 0, 0]);
    assert_eq!(tracking.outside.inactive_ticks, [50, 0, 0], "there were no commands");
}

#[test]
fn force_command_above_limit_counts_only_active_ticks() {
    let mut metrics = Metrics::new();
    metrics.push_operator(&operator(1, 0, 0.0));
    for tick in 0..10 {
        metrics.push_state(&state(tick, [0.0; 3], 0.0));
    }
    metrics.push_command(&command(0, [0.0, 0.0, 999.0], "hold", "none"));
    metrics.push_command(&command(1, [-75.0, 150.0, 30.0], "active", "fresh"));
    metrics.push_command(&command(2, [0.0, 0.0, -360.0], "active", "fresh"));
    metrics.push_command(&command(3, [0.0, 0.0, 999.0], "brake", "none"));
    let force = metrics.summary().force_command;
    assert_eq!(force.max_n, [75.0, 150.0, 360.0]);
    assert_eq!(force.limit_n, [150.0, 150.0, 300.0]);
    assert_eq!(force.max_ratio, [0.5, 1.0, 1.2]);
    assert_eq!((force.active_ticks, force.at_limit_ticks), (2, [0, 1, 1]));
    assert_eq!(force.above_limit_ticks, 1);
}

#[test]
fn ticks_lost_and_missed_are_counted() {
    let mut metrics = Metrics::new();
    for tick in 10..1000 {
        if tick != 700 {
            metrics.push_state(&state(tick, [0.0; 3], 0.0));
        }
        // The run ends before the last state is answered.
        if ![30, 31, 999].contains(&tick) {
            let (mode, source) = match tick {
                ..20 => ("hold", "none"),
                500 => ("active", "repeated"),
                501 => ("brake", "none"),
                _ => ("active", "fresh"),
            };
            metrics.push_command(&command(tick, [0.0; 3], mode, source));
        }
    }
    let summary = metrics.summary();
    assert_eq!((summary.ticks.first, summary.ticks.last), (Some(10), Some(999)));
    assert_eq!((summary.ticks.missing_states, summary.ticks.missing_commands, summary.ticks.lost), (1, 2, 3));
    assert_eq!(summary.timing.missed_ticks, 2);
}

#[test]
fn metrics_unordered_topics_give_same_summary() {
    let force = |tick: i64| 50.0 + 0.01 * (tick % 7) as f64;
    let sets = [operator(1, 0, 50.0), operator(2, 900, 60.0)];
    let straight = run(&sets, 1280, force, |_| 0.0);
    let mut metrics = Metrics::new();
    metrics.push_operator(&sets[0]);
    for block in 0..40 {
        let ticks = block * 32..(block + 1) * 32;
        ticks.clone().rev().for_each(|tick| metrics.push_command(&command(tick, [0.0; 3], "active", "fresh")));
        ticks.clone().for_each(|tick| metrics.push_reference(&reference(tick, 0.0)));
        if block == 28 {
            metrics.push_operator(&sets[1]);
        }
        ticks.for_each(|tick| metrics.push_state(&state(tick, [0.0; 3], force(tick))));
    }
    assert_eq!(metrics.summary(), straight);
}

#[test]
fn metrics_intermediate_summary_changes_nothing() {
    let mut metrics = Metrics::new();
    metrics.push_operator(&operator(1, 0, 50.0));
    for tick in 0..2000 {
        metrics.push_state(&state(tick, [0.0; 3], 50.2));
        metrics.push_reference(&reference(tick, 0.0));
        metrics.push_command(&command(tick, [0.0; 3], "active", "fresh"));
        if tick % 50 == 0 {
            assert_eq!(metrics.summary().ticks.last, Some(tick));
        }
    }
    assert_eq!(metrics.summary(), run(&[operator(1, 0, 50.0)], 2000, |_| 50.2, |_| 0.0));
}

#[test]
fn timing_latency_is_gate_and_lateness_is_plant() {
    let mut metrics = Metrics::new();
    let timing = |process: &str, latency_ns: u64, publish_ns: u64| proto::Timing {
        process: process.into(),
        latency_ns,
        publish_ns,
        allocations: 2,
        ..proto::Timing::default()
    };
    for us in 1..=1000 {
        metrics.push_timing(&timing("supervisor", us * 1000, 1));
    }
    metrics.push_timing(&timing("controller", 900_000_000, 1));
    metrics.push_timing(&timing("supervisor", 900_000_000, 0));
    for tick in 0..100 {
        let wake_lateness_ns = if tick == 50 { 1_700_000 } else { 20_000 };
        metrics.push_state(&proto::State { wake_lateness_ns, slipped: 1, ..state(tick, [0.0; 3], 0.0) });
    }
    let timing = metrics.summary().timing;
    let latency = timing.latency_us.expect("there were latencies");
    for (found, expected) in [(latency.p50, 500.0), (latency.p99, 990.0), (latency.p999, 999.0)] {
        assert!((found / expected - 1.0_f64).abs() < 2e-3, "found {found}, expected {expected}");
    }
    assert_eq!(latency.max, 1000.0);
    let lateness = timing.wake_lateness_us.expect("there were states");
    assert!((lateness.p50 / 20.0 - 1.0).abs() < 2e-3, "{lateness:?}");
    assert_eq!(lateness.max, 1700.0);
    assert_eq!((timing.late_ticks, timing.allocations), (1, 2004));
}

#[test]
fn metrics_without_messages_are_default() {
    let summary = Metrics::new().summary();
    assert_eq!(summary, MetricsSummary::default());
    assert_eq!(summary.ticks.first, None);
}

#[test]
fn metrics_invalid_numbers_are_left_out_and_counted() {
    let mut metrics = Metrics::new();
    metrics.push_operator(&operator(1, 0, 50.0));
    for tick in [0, 1, i64::MIN, i64::MAX, 2] {
        metrics.push_state(&state(tick, [f64::NAN, 0.0, 0.0], 0.0));
        metrics.push_state(&proto::State { tick, ..proto::State::default() });
        metrics.push_reference(&proto::Reference { velocity: vec![f64::INFINITY; 3], ..reference(tick, 0.0) });
        metrics.push_command(&command(tick, [0.0, f64::MAX, 0.0], "active", "fresh"));
    }
    let summary = metrics.summary();
    assert_eq!(summary.ticks.invalid, 20);
    assert_eq!((summary.ticks.first, summary.tracking.max_m), (None, [0.0; 3]));
}

#[test]
fn ticks_far_apart_need_no_time() {
    let mut metrics = Metrics::new();
    for tick in [i64::MIN, -5, 3, i64::MAX - 1] {
        metrics.push_state(&state(tick, [0.0; 3], 0.0));
    }
    let ticks = metrics.summary().ticks;
    assert_eq!((ticks.first, ticks.last), (Some(i64::MIN), Some(i64::MAX - 1)));
    assert_eq!(ticks.missing_states, u64::MAX - 4);
}
