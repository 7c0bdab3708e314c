//! The law in joint space, and the torques of a wrench.

#![allow(clippy::unwrap_used)]

use hapfic_config::Settings;
use hapfic_controller::joint_space::{RequestedTorque, requested_torque};
use hapfic_controller::parameters::{TipPose, parameters};
use hapfic_messages::{MAX_JOINTS, Parameters, State};
use hapfic_robot::Chain;
use nalgebra::{DMatrix, DVector, Vector3};

struct Arm {
    chain: Chain,
    gravity: Vector3<f64>,
    parameters: Parameters,
}

fn arm(overrides: &[&str]) -> Arm {
    let overrides: Vec<String> = overrides.iter().map(|o| (*o).to_owned()).collect();
    let settings = Settings::load("arm-press", &overrides).unwrap();
    Arm {
        chain: Chain::from_settings(&settings.robot).unwrap(),
        gravity: Vector3::from(settings.world.gravity_m_per_s2),
        parameters: parameters(&settings.initial, 1, 0, &TipPose::default()),
    }
}

impl Arm {
    fn torque(&self, state: &State, force: [f64; 3], moment: [f64; 3]) -> RequestedTorque {
        requested_torque(&self.chain, &self.gravity, state, &self.parameters, &Vector3::from(force), &Vector3::from(moment))
    }
}

/// A posture of the arm near its start, different for each `index`, and a velocity.
fn moving(index: u32) -> State {
    let start = [0.0, 0.2, 0.0, -2.2, 0.0, 2.4, 0.785];
    let mut state = State { joints: 7, ..State::default() };
    for (i, start) in start.iter().enumerate() {
        let wave = f64::from(index * 7 + i as u32).sin();
        state.joint_position[i] = start + 0.3 * wave;
        state.joint_velocity[i] = 0.8 * (f64::from(index) + 2.0 * i as f64).cos();
    }
    state
}

#[test]
fn null_space_torque_gives_tip_no_acceleration() {
    let arm = arm(&["controller.limit_stiffness=0", "controller.posture_lead=0"]);
    let mut largest = 0.0_f64;
    for index in 0..50 {
        let state = moving(index);
        let torque = arm.torque(&state, [0.0; 3], [0.0; 3]).joint_space;
        let kin = arm.chain.kinematics(&state.joint_position);
        let (mass, jacobian) = (arm.chain.mass_matrix(&kin), arm.chain.jacobian(&kin));
        let mass = DMatrix::from_fn(7, 7, |i, j| mass[(i, j)]);
        let acceleration = mass.cholesky().unwrap().solve(&DVector::from_fn(7, |i, _| torque[i]));
        let joints: Vec<f64> = acceleration.iter().copied().collect();
        let size = acceleration.norm();
        largest = largest.max(size);
        let tip = jacobian.linear_mul(&joints).norm();
        let turn = jacobian.angular_mul(&joints).norm();
        assert!(tip < 1e-3 * size.max(1.0) && turn < 1e-3 * size.max(1.0), "{index}: {tip} m/s^2, {turn} rad/s^2 of {size}");
    }
    assert!(largest > 0.5, "the posture moves: {largest} rad/s^2");
}

#[test]
fn posture_torque_stays_below_its_share_of_effort_and_keeps_its_direction() {
    let arm = arm(&["controller.posture_stiffness=10000", "controller.limit_stiffness=0"]);
    let weak = arm_with(&arm, |p| p.joint_space.stiffness = 1.0);
    for index in 0..50 {
        let state = State { joint_velocity: [0.0; MAX_JOINTS], ..moving(index) };
        let (strong, weak) =
            (arm.torque(&state, [0.0; 3], [0.0; 3]).joint_space, weak.torque(&state, [0.0; 3], [0.0; 3]).joint_space);
        for (joint, torque) in arm.chain.joints().iter().zip(&strong) {
            assert!(torque.abs() <= 0.3 * joint.effort * (1.0 + 1e-12), "{torque} N m on {}", joint.name);
        }
        let (a, b) = (DVector::from_row_slice(&strong), DVector::from_row_slice(&weak));
        assert!((a.normalize() - b.normalize()).norm() < 1e-9, "{index}: scaled as a whole");
    }
}

fn arm_with(arm: &Arm, change: impl Fn(&mut Parameters)) -> Arm {
    let mut parameters = arm.parameters;
    change(&mut parameters);
    Arm { chain: arm.chain.clone(), parameters, ..*arm }
}

#[test]
fn limit_springs_push_inwards_only_within_their_margin() {
    let arm = arm(&["controller.posture_stiffness=0", "controller.posture_damping=0"]);
    let limits: Vec<(f64, f64, f64)> = arm.chain.joints().iter().map(|j| (j.lower, j.upper, j.effort)).collect();
    for (i, (lower, upper, effort)) in limits.into_iter().enumerate() {
        let at = |q: f64| {
            let mut state = State { joint_velocity: [0.0; MAX_JOINTS], ..moving(0) };
            state.joint_position[i] = q;
            arm.torque(&state, [0.0; 3], [0.0; 3]).joint_space[i]
        };
        assert_eq!(at(0.5 * (lower + upper)), 0.0);
        assert_eq!((at(lower + 0.101), at(upper - 0.101)), (0.0, 0.0));
        assert!(at(lower + 0.05) > 0.0 && at(upper - 0.05) < 0.0);
        assert!(at(lower - 10.0) <= 0.3 * effort && at(upper + 10.0) >= -0.3 * effort);
    }
}

#[test]
fn torque_is_that_of_the_wrench_the_joint_space_and_gravity() {
    let arm = arm(&["controller.posture_lead=0"]);
    let without = arm_with(&arm, |p| p.gravity_compensation = 0);
    for index in 0..20 {
        let state = moving(index);
        let kin = arm.chain.kinematics(&state.joint_position);
        let jacobian = arm.chain.jacobian(&kin);
        let (force, moment) = ([3.0, -20.0, 11.0], [0.4, 1.5, -0.2]);
        let (linear, angular) =
            (jacobian.linear_transpose_mul(&Vector3::from(force)), jacobian.angular_transpose_mul(&Vector3::from(moment)));
        let gravity = arm.chain.gravity_torque(&kin, &arm.gravity);
        let (with, out) = (arm.torque(&state, force, moment), without.torque(&state, force, moment));
        for i in 0..7 {
            let expected = linear[i] + angular[i] + with.joint_space[i];
            assert!((out.total[i] - expected).abs() < 1e-12, "{} against {expected}", out.total[i]);
            assert!((with.total[i] - expected - gravity[i]).abs() < 1e-12);
        }
    }
}

#[test]
fn leg_has_no_joint_space_unless_asked() {
    let settings = Settings::load("floor", &[]).unwrap();
    let p = parameters(&settings.initial, 1, 0, &TipPose::default());
    assert!(!p.joint_space.acts() && !p.is_pose() && p.gravity_compensation == 0);
}
