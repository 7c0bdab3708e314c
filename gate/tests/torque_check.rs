//! Tolerance of the torque check: relative to 1 N m plus the expected torque.
#![allow(clippy::unwrap_used, missing_docs)]

use hapfic_config::Settings;
use hapfic_gate::TorqueCheck;
use hapfic_messages::{Parameters, Request, State, ValidationError};
use hapfic_robot::Chain;
use nalgebra::Vector3;

struct TorqueCase {
    check: TorqueCheck,
    chain: Chain,
    state: State,
}

fn case() -> TorqueCase {
    let settings = Settings::load("floor", &[]).unwrap();
    let chain = Chain::from_settings(&settings.robot).unwrap();
    let mut state = State { joints: 3, ..State::default() };
    state.joint_position[..3].copy_from_slice(&[0.2, 0.9, -1.8]);
    TorqueCase { check: TorqueCheck::new(chain.clone(), settings.world.gravity_m_per_s2), chain, state }
}

impl TorqueCase {
    /// A request whose torque is J^T F.
    fn request(&self, force: [f64; 3]) -> Request {
        let jacobian = self.chain.jacobian(&self.chain.kinematics(&self.state.joint_position[..3]));
        Request { joints: 3, force, torque: jacobian.linear_transpose_mul(&Vector3::from(force)), ..Request::default() }
    }

    /// Result with the torque of joint 1 off by `by` [N m].
    fn off(&self, force: [f64; 3], by: f64) -> Result<(), ValidationError> {
        let mut request = self.request(force);
        request.torque[1] += by;
        self.check.check(&self.state, &request, &Parameters::default())
    }
}

#[test]
fn torque_check_zero_torque_keeps_absolute_tolerance() {
    let case = case();
    assert_eq!(case.off([0.0; 3], 0.9e-6), Ok(()));
    assert_eq!(case.off([0.0; 3], -0.9e-6), Ok(()));
    for by in [1.1e-6, -1.1e-6] {
        assert!(matches!(case.off([0.0; 3], by), Err(ValidationError::Torque { joint: 1, .. })));
    }
}

#[test]
fn torque_check_tolerance_grows_with_load() {
    let case = case();
    let force = [3000.0, 1000.0, -4000.0];
    let load = case.request(force).torque[1].abs();
    assert!(load > 100.0, "{load}");
    for sign in [1.0, -1.0] {
        assert_eq!(case.off(force, sign * 0.9e-6 * (1.0 + load)), Ok(()));
        assert!(case.off(force, sign * 1.1e-6 * (1.0 + load)).is_err());
    }
}

#[test]
fn torque_check_nan_rejected() {
    let case = case();
    assert!(matches!(case.off([0.0; 3], f64::NAN), Err(ValidationError::Torque { joint: 1, .. })));
    assert!(case.off([f64::NAN, 0.0, 0.0], 0.0).is_err());
    let mut state = case.state;
    state.joint_position[0] = f64::NAN;
    let request = case.request([0.0, 0.0, 10.0]);
    assert!(case.check.check(&state, &request, &Parameters::default()).is_err());
}

#[test]
fn torque_check_other_robot_rejected() {
    let case = case();
    let request = case.request([0.0; 3]);
    let state = State { joints: 4, ..case.state };
    assert_eq!(
        case.check.check(&state, &request, &Parameters::default()),
        Err(ValidationError::Count { field: "joints", found: 4, expected: 3 })
    );
}

#[test]
fn torque_check_gravity_compensation_adds_gravity_torque() {
    let case = case();
    let gravity = Vector3::from(Settings::load("floor", &[]).unwrap().world.gravity_m_per_s2);
    let hold = case.chain.gravity_torque(&case.chain.kinematics(&case.state.joint_position[..3]), &gravity);
    assert!(hold[1].abs() > 0.1, "{hold:?}");
    let compensated = Parameters { gravity_compensation: 1, ..Parameters::default() };
    for (times, accepted_with, accepted_without) in [(1.0, true, false), (0.0, false, true), (-1.0, false, false)] {
        let mut request = case.request([10.0, 0.0, 50.0]);
        for (torque, hold) in request.torque.iter_mut().zip(hold) {
            *torque += times * hold;
        }
        assert_eq!(case.check.check(&case.state, &request, &compensated).is_ok(), accepted_with, "{times} g(q)");
        assert_eq!(case.check.check(&case.state, &request, &Parameters::default()).is_ok(), accepted_without, "{times} g(q)");
    }
}
