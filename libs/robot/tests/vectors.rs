//! The paper's leg against reference vectors from Pinocchio.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use hapfic_robot::{Chain, JointKind, Shape};
use nalgebra::Vector3;

const VECTORS: &str = include_str!("vectors/leg_rigid_body.csv");
const TOLERANCE: f64 = 1e-9;

fn leg() -> Chain {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/robots/leg.urdf");
    let text = std::fs::read_to_string(path).unwrap();
    Chain::from_urdf(&text, "leg.urdf", "base", "foot").unwrap()
}

/// Rows of the reference file; checks the names of its columns.
fn rows() -> Vec<Vec<f64>> {
    let mut lines = VECTORS.lines();
    let mut expected: Vec<String> = Vec::new();
    for name in ["q", "qd", "qdd", "foot"] {
        expected.extend((0..3).map(|i| format!("{name}{i}")));
    }
    for name in ["jac", "mass"] {
        expected.extend((0..9).map(|i| format!("{name}{}{}", i / 3, i % 3)));
    }
    for name in ["gravity", "tau"] {
        expected.extend((0..3).map(|i| format!("{name}{i}")));
    }
    let header: Vec<&str> = lines.next().unwrap().trim().split(',').collect();
    assert_eq!(header, expected);
    let rows: Vec<Vec<f64>> = lines.map(|line| line.trim().split(',').map(|value| value.parse().unwrap()).collect()).collect();
    assert_eq!(rows.len(), 60);
    rows
}

fn close(what: &str, row: usize, found: f64, expected: f64) {
    assert!((found - expected).abs() <= TOLERANCE, "row {row}, {what}: found {found}, expected {expected}");
}

#[test]
fn leg_rigid_body_matches_pinocchio() {
    let leg = leg();
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    for (row, values) in rows().iter().enumerate() {
        let (q, qd, qdd) = (&values[0..3], &values[3..6], &values[6..9]);
        let (foot, jac, mass) = (&values[9..12], &values[12..21], &values[21..30]);
        let (held, torque) = (&values[30..33], &values[33..36]);

        let kin = leg.kinematics(q);
        let jacobian = leg.jacobian(&kin);
        let found_mass = leg.mass_matrix(&kin);
        let found_held = leg.gravity_torque(&kin, &gravity);
        let static_torque = leg.bias(&kin, &[0.0; 3], &gravity);
        let found_torque = leg.inverse_dynamics(&kin, qd, qdd, &gravity);
        for i in 0..3 {
            close("foot", row, kin.tip_position()[i], foot[i]);
            close("gravity", row, found_held[i], held[i]);
            close("gravity by inverse dynamics", row, static_torque[i], held[i]);
            close("tau", row, found_torque[i], torque[i]);
            for j in 0..3 {
                close("jac", row, jacobian.linear[j][i], jac[3 * i + j]);
                close("mass", row, found_mass[(i, j)], mass[3 * i + j]);
            }
        }
    }
}

#[test]
fn leg_joints_and_shapes_match_urdf() {
    let leg = leg();
    assert_eq!(leg.dof(), 3);
    assert_eq!((leg.base_link(), leg.tip_link()), ("base", "foot"));
    let names: Vec<&str> = leg.joints().iter().map(|joint| joint.name.as_str()).collect();
    assert_eq!(names, ["haa", "hfe", "kfe"]);
    let knee = &leg.joints()[2];
    assert_eq!((knee.kind, knee.child_link.as_str()), (JointKind::Revolute, "shank"));
    assert_eq!((knee.lower, knee.upper, knee.effort, knee.velocity_limit, knee.damping), (-2.9, 2.9, 80.0, 20.0, 0.0));

    let shapes: Vec<(&str, Option<usize>, Shape)> =
        leg.collisions().iter().map(|collision| (collision.link.as_str(), collision.body, collision.shape.clone())).collect();
    assert_eq!(
        shapes,
        [
            ("thigh", Some(1), Shape::Cylinder { radius: 0.02, length: 0.3 }),
            ("shank", Some(2), Shape::Cylinder { radius: 0.02, length: 0.275 }),
            ("foot", Some(2), Shape::Sphere { radius: 0.02 }),
        ]
    );
    // The foot's sphere is centred on the tip frame.
    let kin = leg.kinematics(&[0.1, -0.4, 0.9]);
    let sphere = leg.collision_pose(&kin, &leg.collisions()[2]);
    assert!((sphere.translation.vector - kin.tip_position()).norm() < 1e-12);
}
