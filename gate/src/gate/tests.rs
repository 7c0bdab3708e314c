//! Tests of the gate: choice of a request, severity, torque, and carried state.

use super::*;
use crate::severity::CLEAR_AFTER;
use hapfic_config::{Settings, TorqueSaturation};
use hapfic_robot::Chain;
use nalgebra::Vector3;

mod conditioning;

const NO_INPUTS: GateInputs = GateInputs { stop: false, rearm: false, missing: false };
const NO_ANSWER: Observation = Observation { valid: [false; 2], rejected: [false; 2], present: [true; 2], overdue: true };

fn chain() -> Chain {
    Chain::from_settings(&Settings::load("floor", &[]).unwrap().robot).unwrap()
}

fn limits(bandwidth_hz: Option<f64>) -> GateLimits {
    GateLimits {
        joints: 3,
        bandwidth_hz,
        peak: [40.0; MAX_JOINTS],
        saturation: TorqueSaturation::Clip,
        period_s: 1e-3,
        ramp_rate: 2000.0,
        torque_rate: None,
        discontinuity: 10.0,
    }
}

fn limited_by(limits: GateLimits) -> Gate {
    Gate::new(limits, TorqueCheck::new(chain(), [0.0, 0.0, -9.81]))
}

fn gate(bandwidth_hz: Option<f64>) -> Gate {
    limited_by(limits(bandwidth_hz))
}

fn state(gate: &Gate) -> State {
    let mut state = State { tick: gate.tick(), joints: 3, ..State::default() };
    state.joint_position[..3].copy_from_slice(&[0.0, 0.9, -1.8]);
    state
}

fn miss(gate: &mut Gate) -> Command {
    gate.miss(&NO_ANSWER, &NO_INPUTS)
}

fn accept(gate: &mut Gate, request: &Request) -> Command {
    gate.accept(ControllerSlot::First, request, &Observation::alone(), &NO_INPUTS)
}

fn request(tick: i64, torque: f64) -> Request {
    let mut all = [0.0; MAX_JOINTS];
    all[..3].fill(torque);
    Request {
        tick,
        state_tick: tick,
        parameters_version: 1,
        controller: Process::Controller.code(),
        joints: 3,
        torque: all,
        state: ControllerState { offset: [0.001; 3], ..ControllerState::default() },
        ..Request::default()
    }
}

fn feed(gate: &mut Gate, torque: f64) -> Command {
    let request = request(gate.tick(), torque);
    accept(gate, &request)
}

#[test]
fn gate_first_command_holds_brakes_at_tick_minus_one() {
    let mut gate = gate(None);
    assert_eq!((gate.last().tick, gate.last().mode), (-1, Mode::Hold.code()));
    let command = miss(&mut gate);
    assert_eq!((command.tick, command.mode, command.severity), (0, Mode::Hold.code(), 0));
}

#[test]
fn gate_peak_limits_and_marks_joint() {
    let mut gate = gate(None);
    let mut request = request(0, 10.0);
    request.torque[1] = -55.0;
    let command = accept(&mut gate, &request);
    assert_eq!(&command.torque[..3], &[10.0, -40.0, 10.0]);
    assert_eq!(command.limited, 0b010);
    assert_eq!(command.request.torque[1], -55.0);
    assert_eq!(command.request.state.offset, [0.001; 3]);
}

#[test]
fn gate_filter_has_its_bandwidth() {
    let mut gate = gate(Some(20.0));
    let alpha = 1.0 - (-2.0 * std::f64::consts::PI * 20.0 * 1e-3_f64).exp();
    assert!((feed(&mut gate, 10.0).torque[0] - 10.0 * alpha).abs() < 1e-12);
    for _ in 0..200 {
        feed(&mut gate, 10.0);
    }
    assert!((gate.last().torque[0] - 10.0).abs() < 1e-9);
}

#[test]
fn gate_second_miss_brakes_until_twenty_good_ticks() {
    let mut gate = gate(None);
    feed(&mut gate, 7.0);
    let repeated = miss(&mut gate);
    assert_eq!((repeated.mode, repeated.source, repeated.torque[0]), (Mode::Active.code(), Source::Repeated.code(), 7.0));
    assert_eq!(gate.severity(), Severity::Degraded);
    let braked = miss(&mut gate);
    assert_eq!((braked.mode, braked.torque[0]), (Mode::Brake.code(), 0.0));
    assert_eq!(braked.request.state, ControllerState::default(), "controllers start anew");
    for good in 1..=CLEAR_AFTER {
        let command = feed(&mut gate, 3.0);
        let active = command.mode == Mode::Active.code();
        assert_eq!(active, good == CLEAR_AFTER, "after {good} good ticks");
    }
    assert_eq!(gate.last().tick, 2 + i64::from(CLEAR_AFTER));
}

#[test]
fn gate_invalid_request_rejected() {
    let gate = gate(None);
    let state = state(&gate);
    let chain = chain();
    let force = [1.0, -2.0, 30.0];
    let jacobian = chain.jacobian(&chain.kinematics(&state.joint_position[..3]));
    let torque = jacobian.linear_transpose_mul(&Vector3::from(force));
    let valid = Request { force, torque, ..request(0, 0.0) };
    assert_eq!(gate.validate(&valid, &state, &Parameters { version: 1, ..Parameters::default() }), Ok(()));
    for invalid in [
        Request { tick: 1, ..valid },
        Request { state_tick: -1, ..valid },
        Request { parameters_version: 2, ..valid },
        Request { joints: 4, ..valid },
        Request { controller: Process::Plant.code(), ..valid },
        Request { force: [f64::NAN, 0.0, 0.0], ..valid },
        Request { error: [0.0, f64::NAN, 0.0], ..valid },
        Request { error_rate: [f64::INFINITY, 0.0, 0.0], ..valid },
        Request { state: ControllerState { offset: [0.0, 0.0, f64::NAN], ..valid.state }, ..valid },
        Request { state: ControllerState { x_max: [f64::NAN; 3], ..valid.state }, ..valid },
        Request { state: ControllerState { converging: [2, 0, 0], ..valid.state }, ..valid },
        Request { torque: [f64::INFINITY; MAX_JOINTS], ..valid },
        Request { torque: [1.0; MAX_JOINTS], ..valid },
        Request { force: [1.0, -2.0, 31.0], ..valid },
    ] {
        assert!(gate.validate(&invalid, &state, &Parameters { version: 1, ..Parameters::default() }).is_err(), "{invalid:?}");
    }
}

#[test]
fn gate_after_brake_torque_ramps_in() {
    let mut gate = gate(None);
    feed(&mut gate, 30.0);
    miss(&mut gate);
    miss(&mut gate);
    for _ in 1..CLEAR_AFTER {
        assert_eq!(feed(&mut gate, 30.0).mode, Mode::Brake.code());
    }
    let mut before = 0.0;
    for tick in 1..=15 {
        let command = feed(&mut gate, 30.0);
        assert!((command.torque[0] - before - 2.0).abs() < 1e-12, "tick {tick}: {before} -> {}", command.torque[0]);
        assert_eq!(command.ramped, if tick < 15 { 0b111 } else { 0 });
        before = command.torque[0];
    }
    // A torque within the limits may step.
    let command = feed(&mut gate, -8.0);
    assert_eq!((command.torque[0], command.ramped), (-8.0, 0));
    assert_eq!(gate.discontinuity(), Some(TorqueStep { joint: 2, size: -38.0 }));
    feed(&mut gate, -17.0);
    assert_eq!(gate.discontinuity(), None, "below the reported size");
}

#[test]
fn gate_stop_latched_until_rearm_to_brake() {
    let mut gate = gate(None);
    feed(&mut gate, 5.0);
    let stop = GateInputs { stop: true, ..NO_INPUTS };
    let first = request(gate.tick(), 5.0);
    let stopped = gate.accept(ControllerSlot::First, &first, &Observation::alone(), &stop);
    assert_eq!((stopped.mode, stopped.source, stopped.torque[0]), (Mode::Stopped.code(), Source::Suppressed.code(), 0.0));
    assert_eq!(stopped.request.state, ControllerState::default());
    for _ in 0..3 * CLEAR_AFTER {
        assert_eq!(feed(&mut gate, 5.0).mode, Mode::Stopped.code());
    }
    let again = request(gate.tick(), 5.0);
    let rearmed = gate.accept(ControllerSlot::First, &again, &Observation::alone(), &GateInputs { rearm: true, ..NO_INPUTS });
    assert_eq!(rearmed.mode, Mode::Brake.code());
    let mut ticks = 0;
    while feed(&mut gate, 5.0).mode != Mode::Active.code() {
        ticks += 1;
    }
    assert_eq!((ticks + 1, gate.last().torque[0]), (CLEAR_AFTER, 2.0), "ramping in");
}

/// Clears a brake with good ticks whose torque is not passed on; the next request is the first that counts.
fn clear(gate: &mut Gate, torque: f64) {
    for _ in 1..CLEAR_AFTER {
        assert_eq!(feed(gate, torque).mode, Mode::Brake.code());
    }
}

#[test]
fn gate_brake_resets_filter() {
    let mut gate = gate(Some(20.0));
    for _ in 0..200 {
        feed(&mut gate, 30.0);
    }
    miss(&mut gate);
    miss(&mut gate);
    clear(&mut gate, 10.0);
    let alpha = 1.0 - (-2.0 * std::f64::consts::PI * 20.0 * 1e-3_f64).exp();
    assert!((feed(&mut gate, 10.0).torque[0] - 10.0 * alpha).abs() < 1e-12, "no torque from before the brake");
}

#[test]
fn gate_ramp_continues_from_limited_torque() {
    let mut gate = gate(None);
    feed(&mut gate, 1.0);
    miss(&mut gate);
    miss(&mut gate);
    clear(&mut gate, 100.0);
    for _ in 0..60 {
        feed(&mut gate, 100.0);
    }
    assert_eq!((gate.last().torque[0], gate.last().limited, gate.last().ramped), (40.0, 0b111, 0b111));
    assert_eq!(feed(&mut gate, -8.0).torque[0], 38.0, "2 N m below the last published torque");
}

/// A gate whose last command is limited on one joint and ramping on the others, with force and controller state.
fn saturated() -> Gate {
    let mut gate = gate(None);
    feed(&mut gate, 1.0);
    miss(&mut gate);
    miss(&mut gate);
    clear(&mut gate, 100.0);
    for _ in 0..10 {
        feed(&mut gate, 100.0);
    }
    let mut request = Request { force: [1.0, 2.0, 3.0], ..request(gate.tick(), 100.0) };
    request.torque[2] = 22.0;
    gate.limits.peak[1] = 21.0;
    let command = accept(&mut gate, &request);
    assert_eq!((&command.torque[..3], command.limited, command.ramped), (&[22.0, 21.0, 22.0][..], 0b010, 0b011));
    gate
}

#[test]
fn gate_repeat_keeps_whole_command() {
    let mut gate = saturated();
    let before = *gate.last();
    let expected =
        Command { tick: before.tick + 1, source: Source::Repeated.code(), severity: Severity::Degraded.code(), ..before };
    let gate_state = GateState { missed: 1, good: 0, ..before.gate };
    assert_eq!(miss(&mut gate), Command { gate: gate_state, ..expected });
}

#[test]
fn gate_brake_clears_whole_command() {
    let mut gate = saturated();
    let before = *gate.last();
    miss(&mut gate);
    let expected = Command {
        tick: before.tick + 2,
        mode: Mode::Brake.code(),
        source: Source::None.code(),
        severity: Severity::Brake.code(),
        limited: 0,
        ramped: 0,
        rate_limited: 0,
        torque: [0.0; MAX_JOINTS],
        request: Request { state: ControllerState::default(), torque: [0.0; MAX_JOINTS], force: [0.0; 3], ..before.request },
        ..before
    };
    // Filter and ramp are cleared.
    let gate_state = GateState { missed: 2, opened: 1, ..GateState::default() };
    assert_eq!(miss(&mut gate), Command { gate: gate_state, ..expected });
    let suppressed = feed(&mut gate, 5.0);
    let gate_state = GateState { missed: 0, good: 1, ..gate_state };
    let source = Source::Suppressed.code();
    assert_eq!(suppressed, Command { tick: expected.tick + 1, source, gate: gate_state, ..expected });
}

#[test]
fn gate_pass_replaces_whole_command() {
    let mut gate = saturated();
    let before = *gate.last();
    let request = Request { stamp_ns: 77, ..request(gate.tick(), 21.0) };
    let expected = Command {
        tick: before.tick + 1,
        limited: 0,
        ramped: 0,
        torque: request.torque,
        request: Request { stamp_ns: 0, ..request },
        ..before
    };
    // The ramp has ended.
    let gate_state = GateState { filtered: request.torque, ramping: 0, ..before.gate };
    assert_eq!(accept(&mut gate, &request), Command { gate: gate_state, ..expected });
}

#[test]
fn gate_stop_before_first_torque_then_rearm_holds() {
    let mut gate = gate(None);
    let stop = GateInputs { stop: true, ..NO_INPUTS };
    let stopped = gate.miss(&NO_ANSWER, &stop);
    assert_eq!((stopped.mode, stopped.severity), (Mode::Stopped.code(), Severity::Stopped.code()));
    let rearmed = gate.miss(&NO_ANSWER, &GateInputs { rearm: true, ..NO_INPUTS });
    assert_eq!((rearmed.mode, rearmed.severity), (Mode::Hold.code(), Severity::Brake.code()), "no longer stopped");
}

/// A gate that continues behind each command in turn makes the same next command as the gate that never ended, through
/// misses, brakes, changes of the primary, latched stops and their end.
#[test]
fn resumed_gate_makes_same_commands() {
    let mut limits = limits(Some(20.0));
    limits.torque_rate = Some(900.0);
    let mut whole = limited_by(limits);
    let mut rng = 7_u64;
    let mut draw = |below: u64| {
        rng = rng.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (rng >> 33) % below
    };
    let mut seen_modes = std::collections::BTreeSet::new();
    for tick in 0..4000_i64 {
        let last = *whole.last();
        let mut resumed = if tick == 0 { whole.clone() } else { Gate::resume(limits, whole.check.clone(), last) };
        // Runs of good ticks, or a brake would never clear.
        let bad = (tick / 50) % 2 == 1 && draw(3) == 0;
        let [stop, rearm] = [draw(400) == 0, draw(60) == 0];
        let inputs = GateInputs { stop, rearm, missing: draw(100) == 0 };
        let orders = [last.gate.stops + u64::from(stop), last.gate.rearms + u64::from(rearm)];
        let slot = if draw(8) == 0 { ControllerSlot::Second } else { ControllerSlot::First };
        let seen = Observation { present: [draw(30) > 0, true], ..Observation::alone() };
        let request = request(tick, draw(1000) as f64 / 10.0 - 50.0);
        let step = |gate: &mut Gate| {
            gate.take_orders(orders[0], orders[1]);
            if bad { gate.miss(&NO_ANSWER, &inputs) } else { gate.accept(slot, &request, &seen, &inputs) }
        };
        let (a, b) = (step(&mut whole), step(&mut resumed));
        assert_eq!(a, b, "tick {tick}");
        assert_eq!((whole.severity(), whole.primary(), whole.orders()), (resumed.severity(), resumed.primary(), orders));
        seen_modes.insert((a.mode, a.source));
    }
    assert!(seen_modes.len() >= 5, "{seen_modes:?}");
}
