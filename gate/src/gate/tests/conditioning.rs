//! Rate limit and saturation of the torque: examples, and properties over any sequence of requests, misses and stops.

use super::*;
use hapfic_controller::torque_filter::{LowPass, limit};
use proptest::prelude::*;

/// Largest rounding error of a step [N m].
const ROUNDING: f64 = 1e-12;

fn with_rate(rate: f64) -> GateLimits {
    GateLimits { torque_rate: Some(rate), ..limits(None) }
}

fn scaled(limits: GateLimits) -> GateLimits {
    GateLimits { saturation: TorqueSaturation::Scale, ..limits }
}

fn feed_all(gate: &mut Gate, torque: [f64; 3]) -> Command {
    let mut request = request(gate.tick(), 0.0);
    request.torque[..3].copy_from_slice(&torque);
    accept(gate, &request)
}

#[test]
fn rate_first_active_tick_starts_from_zero() {
    let mut gate = limited_by(with_rate(5000.0));
    let command = feed_all(&mut gate, [30.0, 4.0, -30.0]);
    assert_eq!((&command.torque[..3], command.rate_limited), (&[5.0, 4.0, -5.0][..], 0b101));
    assert_eq!((command.ramped, command.limited), (0, 0));
}

#[test]
fn rate_missed_tick_does_not_enlarge_next_step() {
    let mut gate = limited_by(with_rate(5000.0));
    feed(&mut gate, 30.0);
    let repeated = miss(&mut gate);
    assert_eq!((repeated.torque[0], repeated.rate_limited), (5.0, 0b111), "repeats the whole command");
    assert_eq!(feed(&mut gate, 30.0).torque[0], 10.0);
}

#[test]
fn rate_and_ramp_smaller_one_acts_and_is_named() {
    for (rate, step, [ramped, rate_limited]) in [(1000.0, 1.0, [0, 0b111]), (2000.0, 2.0, [0b111, 0]), (3000.0, 2.0, [0b111, 0])]
    {
        let mut gate = limited_by(with_rate(rate));
        feed(&mut gate, 1.0);
        miss(&mut gate);
        miss(&mut gate);
        clear(&mut gate, 6.0);
        let command = feed(&mut gate, 6.0);
        assert_eq!((command.torque[0], command.ramped, command.rate_limited), (step, ramped, rate_limited), "{rate} N m/s");
        for _ in 0..6 {
            feed(&mut gate, 6.0);
        }
        assert_eq!((gate.last().torque[0], gate.last().ramped, gate.last().rate_limited), (6.0, 0, 0));
        let after = feed(&mut gate, -30.0);
        assert_eq!((after.torque[0], after.ramped, after.rate_limited), (6.0 - rate * 1e-3, 0, 0b111), "the ramp has ended");
    }
}

#[test]
fn rate_clipped_joint_is_not_rate_limited() {
    let mut gate = limited_by(with_rate(5000.0));
    for _ in 0..8 {
        feed(&mut gate, 100.0);
    }
    assert_eq!((gate.last().torque[0], gate.last().limited, gate.last().rate_limited), (40.0, 0, 0b111));
    let clipped = feed(&mut gate, 100.0);
    assert_eq!((clipped.torque[0], clipped.limited, clipped.rate_limited), (40.0, 0b111, 0));
}

#[test]
fn rate_brake_clears_its_bits() {
    let mut gate = limited_by(with_rate(1000.0));
    feed(&mut gate, 30.0);
    miss(&mut gate);
    assert_eq!((miss(&mut gate).rate_limited, gate.last().torque[0]), (0, 0.0));
}

#[test]
fn scale_keeps_direction_and_names_joints_beyond_peak() {
    let mut gate = limited_by(scaled(limits(None)));
    let command = feed_all(&mut gate, [10.0, -80.0, 50.0]);
    assert_eq!((&command.torque[..3], command.limited), (&[5.0, -40.0, 25.0][..], 0b110));
    let within = feed_all(&mut gate, [10.0, -40.0, 39.0]);
    assert_eq!((&within.torque[..3], within.limited), (&[10.0, -40.0, 39.0][..], 0));
}

#[test]
fn scale_each_joint_has_its_peak() {
    let mut limits = scaled(limits(None));
    limits.peak[..3].copy_from_slice(&[10.0, 40.0, 5.0]);
    // A list for the robot's joints leaves the others at zero.
    limits.peak[3..].fill(0.0);
    let command = feed_all(&mut limited_by(limits), [12.0, 40.0, 20.0]);
    assert_eq!((&command.torque[..3], command.limited), (&[3.0, 10.0, 5.0][..], 0b101));
}

#[test]
fn scale_entries_beyond_joints_do_not_count() {
    let mut limits = scaled(limits(None));
    limits.peak[3..].fill(0.0);
    let mut gate = limited_by(limits);
    let mut request = request(0, 20.0);
    request.torque[3] = 1e9;
    let command = accept(&mut gate, &request);
    assert_eq!((&command.torque[..4], command.limited), (&[20.0, 20.0, 20.0, 0.0][..], 0));
}

#[test]
fn scale_rate_slows_all_joints_together() {
    let mut gate = limited_by(scaled(with_rate(5000.0)));
    let first = feed_all(&mut gate, [20.0, -10.0, 3.0]);
    assert_eq!((&first.torque[..3], first.rate_limited), (&[5.0, -2.5, 0.75][..], 0b011));
    for _ in 0..3 {
        feed_all(&mut gate, [20.0, -10.0, 3.0]);
    }
    assert_eq!((&gate.last().torque[..3], gate.last().rate_limited), (&[20.0, -10.0, 3.0][..], 0));
}

#[test]
fn scale_ramp_after_brake_keeps_direction() {
    let mut gate = limited_by(scaled(limits(None)));
    feed(&mut gate, 1.0);
    miss(&mut gate);
    miss(&mut gate);
    clear(&mut gate, 1.0);
    for tick in 1..=20 {
        let command = feed_all(&mut gate, [80.0, -20.0, 8.0]);
        let share = 2.0 * f64::from(tick);
        assert!((command.torque[0] - share).abs() < ROUNDING && (command.torque[1] + share / 4.0).abs() < ROUNDING);
        assert_eq!((command.limited, command.ramped != 0), (0b001, tick < 20), "tick {tick}");
    }
}

#[test]
fn saturated_torque_leaves_filter_as_it_is() {
    for limits in [scaled(limits(Some(20.0))), GateLimits { torque_rate: Some(100.0), ..limits(Some(20.0)) }] {
        let mut gate = limited_by(limits);
        let mut filter = LowPass::default();
        for tick in 0..100 {
            let torque = if tick < 50 { 100.0 } else { 0.1 };
            feed(&mut gate, torque);
            filter = filter.step(&request(0, torque).torque, Some(20.0), 1e-3);
        }
        // Long enough for the slow torque to arrive.
        for _ in 0..1000 {
            feed(&mut gate, 0.1);
            filter = filter.step(&request(0, 0.1).torque, Some(20.0), 1e-3);
        }
        assert_eq!(gate.last().torque[..3], filter.output[..3]);
    }
}

/// Event of a tick.
#[derive(Clone, Copy, Debug)]
enum TickEvent {
    Request([f64; 3]),
    Miss,
    Stop,
    Rearm,
    /// So many good ticks with one torque: long enough to leave a brake.
    Good([f64; 3], u8),
}

fn torques() -> impl Strategy<Value = [f64; 3]> {
    prop_oneof![8 => prop::array::uniform3(-120.0..120.0), 1 => prop::array::uniform3(-1e300..1e300), 1 => Just([0.0; 3])]
}

fn events() -> impl Strategy<Value = Vec<TickEvent>> {
    let event = prop_oneof![
        8 => torques().prop_map(TickEvent::Request),
        2 => Just(TickEvent::Miss),
        1 => Just(TickEvent::Stop),
        2 => Just(TickEvent::Rearm),
        4 => (torques(), 15..60_u8).prop_map(|(torque, ticks)| TickEvent::Good(torque, ticks)),
    ];
    prop::collection::vec(event, 1..60)
}

fn any_limits() -> impl Strategy<Value = GateLimits> {
    let filter = prop::option::of(5.0..500.0);
    let rate = prop::option::of(prop_oneof![1.0..1e5, 1e-3..1.0]);
    (filter, rate, prop::array::uniform3(0.5..60.0), 10.0..1e5, any::<bool>()).prop_map(
        |(filter, torque_rate, peaks, ramp_rate, scale)| {
            let mut limits = GateLimits { torque_rate, ramp_rate, ..limits(filter) };
            limits.peak = [0.0; MAX_JOINTS];
            limits.peak[..3].copy_from_slice(&peaks);
            if scale { scaled(limits) } else { limits }
        },
    )
}

/// Runs the events, and passes each command with the one before and the request, if there was one.
fn run(gate: &mut Gate, events: &[TickEvent], mut each: impl FnMut(&Command, &Command, Option<[f64; 3]>)) {
    for event in events {
        let (torque, ticks, inputs) = match *event {
            TickEvent::Request(torque) => (Some(torque), 1, NO_INPUTS),
            TickEvent::Good(torque, ticks) => (Some(torque), ticks, NO_INPUTS),
            TickEvent::Miss => (None, 1, NO_INPUTS),
            TickEvent::Stop => (None, 1, GateInputs { stop: true, ..NO_INPUTS }),
            TickEvent::Rearm => (None, 1, GateInputs { rearm: true, ..NO_INPUTS }),
        };
        for _ in 0..ticks {
            let before = *gate.last();
            let after = match torque {
                Some(torque) => {
                    let mut request = request(gate.tick(), 0.0);
                    request.torque[..3].copy_from_slice(&torque);
                    gate.accept(ControllerSlot::First, &request, &Observation::alone(), &inputs)
                }
                None => gate.miss(&NO_ANSWER, &inputs),
            };
            each(&before, &after, torque);
        }
    }
}

fn active(command: &Command) -> bool {
    command.mode == Mode::Active.code()
}

proptest! {
    #[test]
    fn any_sequence_holds_rate_and_peak(limits in any_limits(), events in events()) {
        let mut failure = None;
        run(&mut limited_by(limits), &events, |before, after, _| {
            for joint in 0..3 {
                let (step, peak) = ((after.torque[joint] - before.torque[joint]).abs(), limits.peak[joint]);
                let within = |rate: f64| step <= rate * limits.period_s + ROUNDING;
                let rate = !active(after) || limits.torque_rate.is_none_or(within);
                let ramp = after.ramped == 0 || after.source == Source::Repeated.code() || within(limits.ramp_rate);
                if !(rate && ramp && after.torque[joint].abs() <= peak) {
                    failure = Some((*before, *after));
                }
            }
        });
        prop_assert!(failure.is_none(), "{failure:?}");
    }

    #[test]
    fn any_sequence_at_constant_request_arrives(limits in any_limits(), events in events(), torque in torques()) {
        let limits = GateLimits { torque_rate: limits.torque_rate.map(|rate| rate.max(1000.0)), ramp_rate: 1e3, bandwidth_hz: None, ..limits };
        let mut gate = limited_by(limits);
        run(&mut gate, &events, |_, _, _| ());
        run(&mut gate, &[TickEvent::Rearm, TickEvent::Good(torque, 255)], |_, _, _| ());
        let mut fresh = limited_by(GateLimits { torque_rate: None, ..limits });
        prop_assert_eq!(gate.last().torque, feed_all(&mut fresh, torque).torque);
        // A clipped joint beyond its peak counts as ramping until its torque is within.
        prop_assert_eq!((gate.last().ramped & !gate.last().limited, gate.last().rate_limited), (0, 0));
    }

    #[test]
    fn scale_any_torque_keeps_direction(limits in any_limits(), requests in prop::collection::vec(torques(), 1..40)) {
        let limits = scaled(GateLimits { torque_rate: None, ..limits });
        let mut gate = limited_by(limits);
        let mut filter = LowPass::default();
        for torque in requests {
            let command = feed_all(&mut gate, torque);
            filter = filter.step(&command.request.torque, limits.bandwidth_hz, limits.period_s);
            let unit = |t: &[f64; MAX_JOINTS]| {
                let largest = t[..3].iter().fold(0.0_f64, |most, x| most.max(x.abs()));
                Vector3::from_column_slice(&t[..3]) / if largest > 0.0 { largest } else { 1.0 }
            };
            prop_assert!((unit(&command.torque) - unit(&filter.output)).amax() <= 1e-12, "{:?} {:?}", command.torque, filter.output);
            for joint in 0..3 {
                let beyond = filter.output[joint].abs() > limits.peak[joint];
                prop_assert_eq!(command.limited & (1 << joint) != 0, beyond);
            }
            // As large as the peaks admit.
            let full = (0..3).any(|joint| (command.torque[joint].abs() / limits.peak[joint] - 1.0).abs() < 1e-12);
            prop_assert!(command.limited == 0 || full, "{:?}", command.torque);
        }
    }

    /// The conditioning before rate limit and scaling, as reference.
    #[test]
    fn defaults_any_sequence_equal_filter_ramp_clip(bandwidth in prop::option::of(5.0..500.0), events in events()) {
        let limits = limits(bandwidth);
        let (mut filter, mut ramp) = (LowPass::default(), None);
        let mut failure = None;
        run(&mut limited_by(limits), &events, |before, after, torque| {
            let Some(_) = torque.filter(|_| active(after)) else {
                if !active(after) {
                    (filter, ramp) = (LowPass::default(), None);
                }
                return;
            };
            if before.mode >= Mode::Brake.code() {
                ramp = Some([0.0; MAX_JOINTS]);
            }
            filter = filter.step(&after.request.torque, limits.bandwidth_hz, limits.period_s);
            let (mut desired, mut ramped) = (filter.output, 0);
            if let Some(before) = ramp {
                let most = limits.ramp_rate * limits.period_s;
                for (i, (desired, before)) in desired.iter_mut().zip(before).enumerate().take(limits.joints) {
                    let step: f64 = *desired - before;
                    if step.abs() > most {
                        *desired = before + most.copysign(step);
                        ramped |= 1 << i;
                    }
                }
            }
            let (torque, limited) = limit(&desired, &limits.peak);
            ramp = if ramped > 0 { Some(torque) } else { None };
            let bits = |torque: [f64; MAX_JOINTS]| torque.map(f64::to_bits);
            let found = (bits(after.torque), after.limited, after.ramped, after.rate_limited);
            if found != (bits(torque), limited, ramped, 0) {
                failure = Some((*before, *after));
            }
        });
        prop_assert!(failure.is_none(), "{failure:?}");
    }
}
