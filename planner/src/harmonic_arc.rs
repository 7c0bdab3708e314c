//! Motion of one axis: acceptance of a target, and evaluation of the reference at a later time.

use core::f64::consts::PI;
use hapfic_messages::AxisPlan;

/// Shortest distance that needs an arc [m]; below it the reference jumps to the target immediately.
///
/// It lies far below the resolution of any coordinate; the rate of an arc over such a length overflows.
const MIN_DISTANCE_M: f64 = 1e-150;

/// Values that all axes share at the acceptance of a target.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Acceptance {
    /// v_max [m/s], > 0.
    pub(crate) peak_speed: f64,
    /// a_max [m/s^2], > 0.
    pub(crate) max_acceleration: f64,
    /// |e|, Euclidean distance to the target [m], >= 0.
    pub(crate) distance: f64,
}

/// A harmonic arc: R (with the sign of the initial error), omega and theta_0 of `e = R (1 + cos(theta_0 + omega t))`.
#[derive(Clone, Copy, Debug, Default)]
struct Arc {
    amplitude: f64,
    rate: f64,
    phase: f64,
}

/// Returns the plan at rest on a position [m].
pub(crate) fn rest(position: f64) -> AxisPlan {
    AxisPlan { target: position, start: position, ..AxisPlan::default() }
}

/// Plans the motion to `target` [m] from `position` [m] and `velocity` [m/s] (eqs. 2-3).
///
/// Returns `None` if the numbers are too large or too small to represent the plan.
pub(crate) fn accept(target: f64, position: f64, velocity: f64, acceptance: &Acceptance) -> Option<AxisPlan> {
    let error = target - position;
    let plan = if velocity == 0.0 {
        let speed = acceptance.peak_speed * error.abs() / acceptance.distance;
        let arc = arc_from_rest(error, speed, acceptance.max_acceleration)?;
        with_arc(target, position, arc)
    } else if let Some(arc) = arc_in_motion(error, velocity, acceptance) {
        AxisPlan { start_velocity: velocity, ..with_arc(target, position, arc) }
    } else {
        let brake_time = velocity.abs() / acceptance.max_acceleration;
        let stop = position + 0.5 * velocity * brake_time;
        let error_then = target - stop;
        // An axis that stops farther away than the whole distance still respects v_max.
        let speed = acceptance.peak_speed * error_then.abs() / acceptance.distance.max(error_then.abs());
        let arc = arc_from_rest(error_then, speed, acceptance.max_acceleration)?;
        AxisPlan {
            start_velocity: velocity,
            brake_acceleration: -acceptance.max_acceleration.copysign(velocity),
            brake_time,
            ..with_arc(target, position, arc)
        }
    };
    is_finite(&plan).then_some(plan)
}

/// Returns position [m] and velocity [m/s] at a time `t >= 0` [s] after acceptance.
pub(crate) fn evaluate(plan: &AxisPlan, t: f64) -> (f64, f64) {
    if t < plan.brake_time {
        let position = plan.start + t * (plan.start_velocity + 0.5 * plan.brake_acceleration * t);
        return (position, plan.start_velocity + plan.brake_acceleration * t);
    }
    let theta = plan.phase + plan.rate * (t - plan.brake_time);
    if plan.amplitude == 0.0 || theta >= PI {
        return (plan.target, 0.0);
    }
    // 1 + cos theta = 2 cos^2 (theta / 2), which does not cancel near the target.
    let half = (0.5 * theta).cos();
    (plan.target - 2.0 * plan.amplitude * half * half, plan.amplitude * plan.rate * theta.sin())
}

/// Returns the arc from rest over `error`, with a peak speed of at most `speed`; amplitude 0 below [`MIN_DISTANCE_M`].
fn arc_from_rest(error: f64, speed: f64, max_acceleration: f64) -> Option<Arc> {
    let length = error.abs();
    if length < MIN_DISTANCE_M {
        return Some(Arc::default());
    }
    let rate = (2.0 * speed / length).min((2.0 * max_acceleration / length).sqrt());
    // With a rate that underflows to zero the arc never ends.
    (rate > 0.0).then_some(Arc { amplitude: 0.5 * error, rate, phase: 0.0 })
}

/// Returns the arc that starts with this error and velocity, and ends on the target at rest without overshoot.
///
/// Returns `None` if the axis moves away, is on the target, or is too fast to stop in time.
fn arc_in_motion(error: f64, velocity: f64, acceptance: &Acceptance) -> Option<Arc> {
    let length = error.abs();
    let towards = (error > 0.0) == (velocity > 0.0);
    if length < MIN_DISTANCE_M || !towards {
        return None;
    }
    let speed = velocity.abs();
    let peak = (acceptance.peak_speed * length / acceptance.distance).max(speed);
    // sqrt(V^2 - u^2), factored so that no square overflows.
    let rate = (peak + (peak - speed).sqrt() * (peak + speed).sqrt()) / length;
    let tangent = speed / (rate * length);
    let amplitude = 0.5 * length * (1.0 + tangent * tangent);
    let possible = rate > 0.0 && amplitude * rate * rate <= acceptance.max_acceleration;
    possible.then_some(Arc { amplitude: amplitude.copysign(error), rate, phase: 2.0 * tangent.atan() })
}

fn with_arc(target: f64, start: f64, arc: Arc) -> AxisPlan {
    AxisPlan { target, start, amplitude: arc.amplitude, rate: arc.rate, phase: arc.phase, ..AxisPlan::default() }
}

fn is_finite(plan: &AxisPlan) -> bool {
    [
        plan.target,
        plan.start,
        plan.start_velocity,
        plan.brake_acceleration,
        plan.brake_time,
        plan.amplitude,
        plan.rate,
        plan.phase,
    ]
    .iter()
    .all(|value| value.is_finite())
}
