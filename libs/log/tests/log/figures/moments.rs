//! Metrics: causes of errors, single holds, and the scene.

use super::{Z, assert_close, command, operator, reference, run, state};
use hapfic_log::{Metrics, proto};

#[test]
fn tracking_tick_outside_bound_has_one_cause() {
    let mut metrics = Metrics::new();
    metrics.push_operator(&operator(1, 0, 50.0));
    for tick in 0..60 {
        // The foot has contact in the fourth ten ticks only.
        let force = if (30..40).contains(&tick) { 20.0 } else { 0.0 };
        metrics.push_state(&state(tick, [0.0, 0.0, 0.03], force));
        metrics.push_reference(&reference(tick, 0.0));
        let (force_z, limited, mode) = match tick / 10 {
            0 => (-300.0, 1, "active"),
            1 => (-299.8, 0, "active"),
            2 => (-200.0, 4, "active"),
            3 | 4 => (-200.0, 0, "active"),
            _ => (-300.0, 0, "brake"),
        };
        metrics.push_command(&proto::Command { limited, ..command(tick, [0.0, 0.0, force_z], mode, "fresh") });
    }
    let outside = metrics.summary().tracking.outside;
    assert_eq!(outside.ticks, [0, 0, 60]);
    assert_eq!(outside.force_limited_ticks[Z], 20);
    assert_eq!(outside.torque_limited_ticks[Z], 10);
    assert_eq!(outside.force_held_ticks[Z], 10);
    assert_eq!(outside.unexplained_ticks[Z], 10);
    assert_eq!(outside.inactive_ticks[Z], 10);
}

#[test]
fn force_holds_are_separate_and_worst_is_kept() {
    let sets = [operator(1, 0, 50.0), operator(2, 1000, 100.0), operator(3, 2000, 20.0)];
    let contact = |tick: i64| match tick {
        ..1000 => 50.1,
        1000..2000 => 100.9,
        _ => 20.02,
    };
    let force = run(&sets, 3000, contact, |_| 0.0).force;
    assert_eq!(force.holds, [0, 0, 3]);
    assert_close(force.worst_hold_rms_percent[Z], 0.9);
    assert_close(force.worst_hold_desired_n[Z], 100.0);
    assert_close(force.last_hold_rms_percent[Z], 0.1);
    assert_eq!(force.worst_hold_rms_percent[0], None);
}

#[test]
fn force_axes_have_separate_targets() {
    let set = proto::Operator { desired_force: vec![20.0, -10.0, 0.0], ..operator(1, 0, 0.0) };
    let mut metrics = Metrics::new();
    metrics.push_operator(&set);
    for tick in 0..1000 {
        // No contact along x; along z a contact without a desired force.
        metrics.push_state(&proto::State { foot_force: vec![0.0, -10.05, 44.0], ..state(tick, [0.0; 3], 0.0) });
        metrics.push_reference(&reference(tick, 0.0));
        metrics.push_command(&command(tick, [0.0; 3], "active", "fresh"));
    }
    let force = metrics.summary().force;
    assert_eq!(force.settled_ticks, [0, 500, 0]);
    assert_close(force.settled_rms_percent[1], 0.5);
    assert_eq!(force.desired_n, [Some(20.0), Some(-10.0), None]);
    assert_eq!((force.recoveries, force.unrecovered), ([0, 1, 0], [0; 3]));
}

#[test]
fn force_gain_change_counts_recovery_or_not() {
    let gains =
        |version, tick, stiffness: f64| proto::Operator { stiffness: vec![stiffness; 3], ..operator(version, tick, 50.0) };
    let sets = [gains(1, 0, 6000.0), gains(2, 1000, 18_000.0), gains(3, 2000, 1000.0)];
    let contact = |tick: i64| match tick {
        1000..1160 => 130.0,
        // Once within reach, but not for long enough.
        2500..2550 => 50.0,
        2000.. => 30.0,
        _ => 50.0,
    };
    let force = run(&sets, 3000, contact, |_| 0.0).force;
    assert_eq!((force.recoveries[Z], force.unrecovered[Z]), (2, 1));
    assert_eq!(force.slowest_recovery_ticks[Z], Some(160));
    assert_close(force.overshoot_n[Z], 80.0);
    // Ticks before the recovery do not count as settled.
    assert_eq!(force.holds[Z], 3);
}

/// Body rotated about x by an angle [degrees].
fn body(angle_deg: f64, speed: f64) -> proto::Object {
    let half = 0.5 * angle_deg.to_radians();
    proto::Object {
        name: "box".into(),
        position: vec![0.0, 0.01 * angle_deg, 0.0],
        orientation: vec![half.sin(), 0.0, 0.0, half.cos()],
        linear_velocity: vec![speed, 0.0, 0.0],
        angular_velocity: vec![0.0; 3],
    }
}

fn tipped(angle_deg: f64, rest_ticks: i64) -> hapfic_log::metrics::ObjectSummary {
    let mut metrics = Metrics::new();
    for tick in 0..500 {
        let angle = if tick == 0 { 0.0 } else { angle_deg };
        let speed = if (100..100 + rest_ticks).contains(&tick) { 0.0 } else { 0.01 };
        metrics.push_state(&proto::State { objects: vec![body(angle, speed)], ..state(tick, [0.0; 3], 0.0) });
    }
    let objects = metrics.summary().moments.objects;
    assert_eq!(objects.len(), 1);
    objects[0]
}

#[test]
fn object_tipped_needs_rest_on_other_face() {
    let object = tipped(90.0, 200);
    assert_close(Some(object.max_turn_deg), 90.0);
    assert_close(Some(object.final_turn_deg), 90.0);
    assert_close(Some(object.max_displacement_m), 0.9);
    assert_eq!((object.name.as_str(), object.tipped_at_rest), ("box", true));
    assert!(!tipped(90.0, 199).tipped_at_rest, "too short");
    assert!(!tipped(79.0, 300).tipped_at_rest, "not far enough");
}

#[test]
fn contact_pairs_are_summed_and_count_free_foot() {
    let contact = |body: &str, against: &str, force: f64| proto::Contact {
        body: body.into(),
        against: against.into(),
        point: vec![0.0; 3],
        force: vec![0.0, 0.0, force],
        depth: 1e-4,
    };
    let mut metrics = Metrics::new();
    for tick in 0..30 {
        let mut contacts = vec![contact("shank", "box", 3.0), contact("box", "floor", 20.0), contact("shank", "box", 4.0)];
        let force = if tick < 10 { 5.0 } else { 0.0 };
        if tick < 10 {
            contacts.push(contact("foot", "floor", force));
        }
        metrics.push_state(&proto::State { contacts, ..state(tick, [0.0; 3], force) });
    }
    let pairs = metrics.summary().moments.contacts;
    let found: Vec<_> =
        pairs.iter().map(|p| (p.body.as_str(), p.against.as_str(), p.ticks, p.foot_free_ticks, p.peak_n)).collect();
    let expected = [("shank", "box", 30, 20, 7.0), ("box", "floor", 30, 20, 20.0), ("foot", "floor", 10, 0, 5.0)];
    assert_eq!(found, expected);
}

#[test]
fn posture_counts_straight_knee_and_desired_force_in_air() {
    let mut metrics = Metrics::new();
    metrics.push_operator(&operator(1, 0, 50.0));
    for tick in 0..100 {
        let knee = 0.1 - 0.002 * tick as f64;
        // The foot has contact in the first half.
        let force = if tick < 50 { 50.0 } else { 0.0 };
        metrics.push_state(&proto::State { joint_position: vec![1.0, knee], ..state(tick, [0.0; 3], force) });
        let offset = if tick < 50 { 0.02 } else { 0.001 };
        metrics.push_command(&proto::Command {
            offset: vec![0.005, 0.0, offset],
            error: vec![0.0, 0.0, -2.0 * offset],
            ..command(tick, [0.0; 3], "active", "fresh")
        });
    }
    let moments = metrics.summary().moments;
    assert_eq!(moments.joints.len(), 2);
    assert_close(Some(moments.joints[0].smallest_deg), 1.0_f64.to_degrees());
    assert!(moments.joints[1].smallest_deg < 1e-9);
    // 0.01745 rad are a little more than 8 steps to either side.
    assert_eq!((moments.joints[0].straight_ticks, moments.joints[1].straight_ticks), (0, 17));
    assert_eq!(moments.air.ticks, [0, 0, 50]);
    assert_eq!((moments.air.max_offset_m, moments.air.max_error_m), ([0.0, 0.0, 0.001], [0.0, 0.0, 0.002]));
}

#[test]
fn integration_created_energy_is_rise_above_minimum() {
    // Work and stored energy [J]: a spring that returns its energy creates none.
    let account = [(0.0, 0.0), (-0.5, 0.4), (-0.1, 0.0), (-0.3, 0.0), (-0.3, 0.02), (-0.4, 0.05), (-0.4, 0.11)];
    let mut metrics = Metrics::new();
    for (tick, (contact_work_j, contact_stored_j)) in account.into_iter().enumerate() {
        let physics = proto::Physics {
            substeps: 50,
            contact_substeps: 40,
            newton_iterations: 60,
            unconverged: 1,
            contact_work_j,
            contact_stored_j,
            ..proto::Physics::default()
        };
        metrics.push_state(&proto::State { physics: Some(physics), ..state(tick as i64, [0.0; 3], 0.0) });
    }
    let integration = metrics.summary().integration;
    // From -0.35 to -0.29.
    assert_close(Some(integration.contact_energy_created_j), 0.06);
    assert_close(integration.newton_per_contact_substep, 1.5);
    assert_eq!((integration.substeps, integration.contact_substeps, integration.unconverged), (350, 280, 7));
    assert_eq!(integration.contact_ticks, 0, "no contact was reported");
}
