//! Properties of every chain.

#![allow(clippy::unwrap_used, clippy::expect_used)]

mod random_chain;

use hapfic_robot::{Chain, JointVector, MAX_JOINTS};
use nalgebra::{Matrix3, Rotation3, Vector3};
use proptest::prelude::*;
use random_chain::{
    Inertial, Motion, Segment, chain, fixed_text, inertial, limb_text, motion, read, segment, segment_text, segments, triple,
};

fn gravity() -> impl Strategy<Value = Vector3<f64>> {
    triple(10.0).prop_map(Vector3::from)
}

fn shifted(values: &JointVector, index: usize, by: f64) -> JointVector {
    let mut result = *values;
    result[index] += by;
    result
}

/// The vector of a nearly skew matrix.
fn vee(matrix: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(matrix[(2, 1)] - matrix[(1, 2)], matrix[(0, 2)] - matrix[(2, 0)], matrix[(1, 0)] - matrix[(0, 1)]) * 0.5
}

/// Largest difference between the results of two chains for the same motion, names aside.
fn difference(a: &Chain, b: &Chain, motion: &Motion, gravity: &Vector3<f64>) -> f64 {
    assert_eq!(a.dof(), b.dof());
    let (kin_a, kin_b) = (a.kinematics(&motion.q), b.kinematics(&motion.q));
    let torque = |chain: &Chain, kin| JointColumn::from(chain.inverse_dynamics(kin, &motion.qd, &motion.qdd, gravity));
    let differences = [
        (kin_a.tip_position() - kin_b.tip_position()).norm(),
        (kin_a.tip_rotation() - kin_b.tip_rotation()).norm(),
        (a.mass_matrix(&kin_a) - b.mass_matrix(&kin_b)).norm(),
        (torque(a, &kin_a) - torque(b, &kin_b)).norm(),
        (JointColumn::from(a.gravity_torque(&kin_a, gravity)) - JointColumn::from(b.gravity_torque(&kin_b, gravity))).norm(),
        (a.kinetic_energy(&kin_a, &motion.qd) - b.kinetic_energy(&kin_b, &motion.qd)).abs(),
        (a.potential_energy(&kin_a, gravity) - b.potential_energy(&kin_b, gravity)).abs(),
    ];
    assert!(differences.iter().all(|difference| difference.is_finite()), "{differences:?}");
    differences.into_iter().fold(0.0, f64::max)
}

type JointColumn = nalgebra::SVector<f64, MAX_JOINTS>;

proptest! {
    #[test]
    fn tip_same_bits_as_kinematics_and_jacobian(
        segments in segments(),
        motion in motion(),
        force in triple(100.0).prop_map(Vector3::from),
        gravity in gravity(),
    ) {
        let chain = chain(&segments);
        let (tip, kin) = (chain.tip::<MAX_JOINTS>(&motion.q), chain.kinematics(&motion.q));
        let jacobian = chain.jacobian(&kin);
        prop_assert_eq!(tip.position, kin.tip_position());
        prop_assert_eq!(tip.velocity(&motion.qd), jacobian.linear_mul(&motion.qd));
        let torque = jacobian.linear_transpose_mul(&force);
        prop_assert_eq!(chain.tip_force_torque::<MAX_JOINTS>(&motion.q, &force, None), torque);
        let hold = chain.gravity_torque(&kin, &gravity);
        let both: JointVector = core::array::from_fn(|i| torque[i] + hold[i]);
        prop_assert_eq!(chain.tip_force_torque(&motion.q, &force, Some(&gravity)), both);
    }

    #[test]
    fn jacobian_is_tip_pose_derivative(segments in segments(), motion in motion()) {
        let chain = chain(&segments);
        let jacobian = chain.jacobian(&chain.kinematics(&motion.q));
        let h = 1e-6;
        for i in 0..chain.dof() {
            let ahead = chain.kinematics(&shifted(&motion.q, i, h));
            let behind = chain.kinematics(&shifted(&motion.q, i, -h));
            let linear = (ahead.tip_position() - behind.tip_position()) / (2.0 * h);
            let angular = vee(&(ahead.tip_rotation() * behind.tip_rotation().transpose())) / (2.0 * h);
            prop_assert!((linear - jacobian.linear[i]).norm() < 1e-6, "linear {i}: {linear} {}", jacobian.linear[i]);
            prop_assert!((angular - jacobian.angular[i]).norm() < 1e-6, "angular {i}: {angular} {}", jacobian.angular[i]);
        }
    }

    #[test]
    fn point_jacobian_is_point_derivative(
        segments in segments(), motion in motion(), which in any::<prop::sample::Index>(), local in triple(0.5),
    ) {
        let chain = chain(&segments);
        let body = which.index(chain.dof());
        let local = Vector3::from(local);
        let place = |q: &JointVector| {
            let kin = chain.kinematics(q);
            kin.body_origin(body) + kin.body_rotation(body) * local
        };
        let jacobian = chain.kinematics(&motion.q).point_jacobian(body, &place(&motion.q));
        let h = 1e-6;
        for i in 0..chain.dof() {
            let linear = (place(&shifted(&motion.q, i, h)) - place(&shifted(&motion.q, i, -h))) / (2.0 * h);
            prop_assert!((linear - jacobian.linear[i]).norm() < 1e-6, "{i}: {linear} {}", jacobian.linear[i]);
            if i > body {
                prop_assert_eq!(jacobian.linear[i], Vector3::zeros());
                prop_assert_eq!(jacobian.angular[i], Vector3::zeros());
            }
        }
    }

    #[test]
    fn jacobian_products_balance_power(segments in segments(), motion in motion(), force in triple(50.0)) {
        let chain = chain(&segments);
        let jacobian = chain.jacobian(&chain.kinematics(&motion.q));
        let force = Vector3::from(force);
        let torque = jacobian.linear_transpose_mul(&force);
        let power: f64 = torque.iter().zip(&motion.qd).map(|(torque, rate)| torque * rate).sum();
        prop_assert!((power - force.dot(&jacobian.linear_mul(&motion.qd))).abs() < 1e-9);
        let torque = jacobian.angular_transpose_mul(&force);
        let power: f64 = torque.iter().zip(&motion.qd).map(|(torque, rate)| torque * rate).sum();
        prop_assert!((power - force.dot(&jacobian.angular_mul(&motion.qd))).abs() < 1e-9);
    }

    #[test]
    fn mass_matrix_is_definite_and_matches_inverse_dynamics(
        segments in segments(), motion in motion(),
    ) {
        let chain = chain(&segments);
        let n = chain.dof();
        let kin = chain.kinematics(&motion.q);
        let mass = chain.mass_matrix(&kin);
        prop_assert_eq!(mass, mass.transpose());
        for j in 0..MAX_JOINTS {
            let column = if j < n {
                let unit = shifted(&[0.0; MAX_JOINTS], j, 1.0);
                chain.inverse_dynamics(&kin, &[0.0; MAX_JOINTS], &unit, &Vector3::zeros())
            } else {
                [0.0; MAX_JOINTS]
            };
            let error = (mass.column(j) - JointColumn::from(column)).norm();
            prop_assert!(error < 1e-9 * (1.0 + mass.norm()), "column {j}: {error}");
        }
        let mut padded = mass;
        for j in n..MAX_JOINTS {
            padded[(j, j)] = 1.0;
        }
        prop_assert!(padded.cholesky().is_some(), "{mass}");
    }

    #[test]
    fn kinetic_energy_matches_mass_matrix(segments in segments(), motion in motion()) {
        let chain = chain(&segments);
        let kin = chain.kinematics(&motion.q);
        let rate = JointColumn::from(motion.qd);
        let expected = 0.5 * rate.dot(&(chain.mass_matrix(&kin) * rate));
        let found = chain.kinetic_energy(&kin, &motion.qd);
        prop_assert!((found - expected).abs() < 1e-9 * (1.0 + expected), "{found} {expected}");
    }

    #[test]
    fn gravity_torque_is_potential_energy_gradient(
        segments in segments(), motion in motion(), gravity in gravity(),
    ) {
        let chain = chain(&segments);
        let kin = chain.kinematics(&motion.q);
        let torque = chain.gravity_torque(&kin, &gravity);
        let at_rest = chain.bias(&kin, &[0.0; MAX_JOINTS], &gravity);
        let energy = |q: &JointVector| chain.potential_energy(&chain.kinematics(q), &gravity);
        let h = 1e-5;
        for i in 0..MAX_JOINTS {
            let gradient = (energy(&shifted(&motion.q, i, h)) - energy(&shifted(&motion.q, i, -h))) / (2.0 * h);
            prop_assert!((torque[i] - gradient).abs() < 1e-5, "{i}: {} {gradient}", torque[i]);
            prop_assert!((torque[i] - at_rest[i]).abs() < 1e-9, "{i}: {} {}", torque[i], at_rest[i]);
        }
    }

    #[test]
    fn torque_power_is_energy_rate(segments in segments(), motion in motion(), gravity in gravity()) {
        let chain = chain(&segments);
        let Motion { q, qd, qdd } = motion;
        let torque = chain.inverse_dynamics(&chain.kinematics(&q), &qd, &qdd, &gravity);
        let power: f64 = torque[..chain.dof()].iter().zip(&qd).map(|(torque, rate)| torque * rate).sum();
        let energy = |t: f64| {
            let at: JointVector = std::array::from_fn(|i| q[i] + qd[i] * t + 0.5 * qdd[i] * t * t);
            let rate: JointVector = std::array::from_fn(|i| qd[i] + qdd[i] * t);
            let kin = chain.kinematics(&at);
            chain.kinetic_energy(&kin, &rate) + chain.potential_energy(&kin, &gravity)
        };
        let h = 1e-5;
        let change = (energy(h) - energy(-h)) / (2.0 * h);
        let scale = 1.0 + power.abs() + chain.kinetic_energy(&chain.kinematics(&q), &qd) + energy(0.0).abs();
        prop_assert!((power - change).abs() < 1e-6 * scale, "{power} {change}");
    }

    #[test]
    fn fixed_joint_matches_merged_body(
        first in segment(), second in segment(), part in inertial(), xyz in triple(0.4), rpy in triple(1.4),
        motion in motion(), gravity in gravity(),
    ) {
        let tail = |parent: &str, second: &Segment| {
            segment_text(parent, "b", second) + &fixed_text("b", "tip", &[0.1, 0.2, 0.3], &[0.1, 0.2, 0.3], None)
        };
        let head = segment_text("base", "a", &first);
        let lumped = head.clone() + &fixed_text("a", "part", &xyz, &rpy, Some(&part)) + &tail("part", &second);

        let merged = Segment { inertial: merge(&first.inertial, &part, &xyz, &rpy), ..first.clone() };
        let turn = rotation(&rpy);
        let (roll, pitch, yaw) = (turn * rotation(&second.rpy)).euler_angles();
        let moved = Segment {
            xyz: (Vector3::from(xyz) + turn * Vector3::from(second.xyz)).into(),
            rpy: [roll, pitch, yaw],
            ..second.clone()
        };
        let by_hand = segment_text("base", "a", &merged) + &tail("a", &moved);
        prop_assert!(difference(&read(&lumped, "tip"), &read(&by_hand, "tip"), &motion, &gravity) < 1e-8);

        // The same part off the path instead of on it.
        let beside = head + &tail("a", &moved) + &fixed_text("a", "part", &xyz, &rpy, Some(&part));
        prop_assert!(difference(&read(&beside, "tip"), &read(&by_hand, "tip"), &motion, &gravity) < 1e-8);
    }

    #[test]
    fn quadruped_leg_matches_leg_alone(
        legs in prop::collection::vec(segments(), 4), limb in segment(), which in 0..4_usize,
        motion in motion(), gravity in gravity(),
    ) {
        let prefixes = ["lf_", "rf_", "lh_", "rh_"];
        let mut tree = String::new();
        for (prefix, leg) in prefixes.iter().zip(&legs) {
            tree += &limb_text(prefix, "base", leg);
        }
        // Another limb in the middle of each leg, on a movable joint.
        for prefix in prefixes {
            tree += &segment_text(&format!("{prefix}0"), &format!("{prefix}limb"), &limb);
        }
        let picked = read(&tree, &format!("{}tip", prefixes[which]));
        prop_assert_eq!(difference(&picked, &chain(&legs[which]), &motion, &gravity), 0.0);
    }

    #[test]
    fn base_pose_moves_tip_and_rotates_gravity(
        segments in segments(), motion in motion(), gravity in gravity(), at in triple(3.0), rpy in triple(1.4),
    ) {
        let at_origin = chain(&segments);
        let placed = at_origin.clone().with_base(at, rpy);
        let turn = rotation(&rpy);
        let local = turn.inverse() * gravity;
        let (kin, reference) = (placed.kinematics(&motion.q), at_origin.kinematics(&motion.q));

        let tip = Vector3::from(at) + turn * reference.tip_position();
        prop_assert!((kin.tip_position() - tip).norm() < 1e-9);
        prop_assert!((kin.tip_rotation() - turn.matrix() * reference.tip_rotation()).norm() < 1e-9);
        prop_assert!((placed.mass_matrix(&kin) - at_origin.mass_matrix(&reference)).norm() < 1e-9);
        let torque = placed.inverse_dynamics(&kin, &motion.qd, &motion.qdd, &gravity);
        let expected = at_origin.inverse_dynamics(&reference, &motion.qd, &motion.qdd, &local);
        prop_assert!((JointColumn::from(torque) - JointColumn::from(expected)).norm() < 1e-8);
        let held = placed.gravity_torque(&kin, &gravity);
        let expected = at_origin.gravity_torque(&reference, &local);
        prop_assert!((JointColumn::from(held) - JointColumn::from(expected)).norm() < 1e-8);
    }

    #[test]
    fn kinematics_non_finite_position_is_detected(
        segments in segments(), motion in motion(), which in any::<prop::sample::Index>(),
        bad in prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY)],
    ) {
        let chain = chain(&segments);
        prop_assert!(chain.kinematics(&motion.q).is_finite());
        let mut q = motion.q;
        q[which.index(chain.dof())] = bad;
        prop_assert!(!chain.kinematics(&q).is_finite());
    }
}

fn rotation(rpy: &[f64; 3]) -> Rotation3<f64> {
    Rotation3::from_euler_angles(rpy[0], rpy[1], rpy[2])
}

/// Mass, centre and second moment of mass about the origin, sum of m r r^T, which is additive over bodies.
fn second_moment(inertial: &Inertial, place: &Vector3<f64>, turn: &Rotation3<f64>) -> (f64, Vector3<f64>, Matrix3<f64>) {
    let [xx, xy, xz, yy, yz, zz] = inertial.inertia;
    let inertia = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    let spread = Matrix3::<f64>::identity() * (inertia.trace() / 2.0) - inertia;
    let turned = turn * rotation(&inertial.rpy);
    let center = place + turn * Vector3::from(inertial.center);
    let spread = turned.matrix() * spread * turned.matrix().transpose();
    (inertial.mass, center, spread + center * center.transpose() * inertial.mass)
}

/// Merges two bodies, the second one fixed to the first at this pose.
fn merge(a: &Inertial, b: &Inertial, xyz: &[f64; 3], rpy: &[f64; 3]) -> Inertial {
    let (mass_a, center_a, moment_a) = second_moment(a, &Vector3::zeros(), &Rotation3::identity());
    let (mass_b, center_b, moment_b) = second_moment(b, &Vector3::from(*xyz), &rotation(rpy));
    let mass = mass_a + mass_b;
    let center = (center_a * mass_a + center_b * mass_b) / mass;
    let spread = moment_a + moment_b - center * center.transpose() * mass;
    let i = Matrix3::<f64>::identity() * spread.trace() - spread;
    Inertial {
        mass,
        center: center.into(),
        rpy: [0.0; 3],
        inertia: [i[(0, 0)], i[(0, 1)], i[(0, 2)], i[(1, 1)], i[(1, 2)], i[(2, 2)]],
    }
}
