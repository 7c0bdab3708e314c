//! Tolerance of the torque check: relative to 1 N m plus the expected torque.
#![allow(clippy::unwrap_used, missing_docs)]

use hapfic_config::Settings;
use hapfic_controller::control_step::{ControlInputs, PreviousStates, ReferenceSetpoint, control_step};
use hapfic_controller::parameters::{TipPose, parameters};
use hapfic_gate::TorqueCheck;
use hapfic_messages::{Parameters, Process, Request, State, ValidationError};
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

/// Numbers in [-1, 1), the same in every run.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        // An LCG with Knuth's constants; the upper bits are random enough for postures.
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn three(&mut self, scale: f64) -> [f64; 3] {
        core::array::from_fn(|_| scale * self.next())
    }
}

#[test]
fn torque_check_moving_robot_accepts_predicted_posture_only() {
    let settings = Settings::load("floor", &[]).unwrap();
    let TorqueCase { check, chain, mut state } = case();
    let gravity = Vector3::from(settings.world.gravity_m_per_s2);
    let base = parameters(&settings.initial, 1, 0, &TipPose::default());
    assert_eq!(base.posture_lead, 1.5e-3, "the default");
    let mut numbers = Numbers(1);
    let mut refused = 0;
    for round in 0..2000 {
        state.joint_position[..3].copy_from_slice(&numbers.three(2.0));
        state.joint_velocity[..3].copy_from_slice(&numbers.three(10.0));
        state.foot_force = numbers.three(100.0);
        let leading = Parameters { desired_force: numbers.three(50.0), gravity_compensation: round % 2, ..base };
        let late = Parameters { posture_lead: 0.0, ..leading };
        let kin = chain.kinematics(&state.joint_position[..3]);
        let foot = kin.tip_position();
        let away = numbers.three(0.05);
        let request = |parameters: &Parameters| {
            let inputs = ControlInputs {
                state: &state,
                setpoint: ReferenceSetpoint {
                    position: [foot.x + away[0], foot.y + away[1], foot.z + away[2]],
                    ..ReferenceSetpoint::default()
                },
                parameters,
                previous: PreviousStates::default(),
            };
            control_step(&chain, &gravity, &inputs, Process::Controller).unwrap()
        };
        let (predicted, measured) = (request(&leading), request(&late));
        // The law is the same; only the posture of J^T and g differs.
        assert_eq!((predicted.force, predicted.state), (measured.force, measured.state));
        assert_eq!(check.check(&state, &predicted, &leading), Ok(()), "round {round}");
        assert_eq!(check.check(&state, &measured, &late), Ok(()), "round {round}");
        let differs = (0..3).any(|i| {
            let (a, b) = (predicted.torque[i], measured.torque[i]);
            (a - b).abs() > 1e-5 * (1.0 + a.abs().max(b.abs()))
        });
        if differs {
            assert!(matches!(check.check(&state, &measured, &leading), Err(ValidationError::Torque { .. })), "round {round}");
            assert!(matches!(check.check(&state, &predicted, &late), Err(ValidationError::Torque { .. })), "round {round}");
            refused += 1;
        }
    }
    assert!(refused > 1900, "{refused} of 2000 postures tell the two apart");
}

#[test]
fn control_step_lead_not_finite_gives_no_request() {
    let TorqueCase { chain, mut state, .. } = case();
    state.joint_velocity[..3].copy_from_slice(&[1.0, 0.0, 0.0]);
    let base = parameters(&Settings::load("floor", &[]).unwrap().initial, 1, 0, &TipPose::default());
    for lead in [f64::NAN, f64::INFINITY] {
        let inputs = ControlInputs {
            state: &state,
            setpoint: ReferenceSetpoint { position: [0.0; 3], ..ReferenceSetpoint::default() },
            parameters: &Parameters { posture_lead: lead, ..base },
            previous: PreviousStates::default(),
        };
        assert!(control_step(&chain, &Vector3::zeros(), &inputs, Process::Controller).is_none());
    }
}
