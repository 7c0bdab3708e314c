//! One axis of a planned motion: how a target is accepted, and where the reference is a time later.

use core::f64::consts::PI;
use hapfic_messages::AxisPlan;

/// Errors below this are no way to go, m: the reference is set on the target at once. Far below the resolution of any
/// coordinate; an arc over such a length has a rate that overflows.
const NO_WAY_M: f64 = 1e-150;

/// What all axes share when a target is accepted.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Acceptance {
    /// v_max, m/s, > 0.
    pub(crate) peak_speed: f64,
    /// a_max, m/s^2, > 0.
    pub(crate) max_acceleration: f64,
    /// |e|, Euclidean distance to the target, m, >= 0.
    pub(crate) distance: f64,
}

/// A harmonic arc: R (signed like the error it starts from), omega and theta_0 of `e = R (1 + cos(theta_0 + omega t))`.
#[derive(Clone, Copy, Debug, Default)]
struct Arc {
    amplitude: f64,
    rate: f64,
    phase: f64,
}

/// At rest on a position, m.
pub(crate) fn rest(position: f64) -> AxisPlan {
    AxisPlan { target: position, start: position, ..AxisPlan::default() }
}

/// Plans the way to `target` from `position` (m) and `velocity` (m/s), eqs. 2-3.
///
/// `None` if the numbers are so large or small that the plan cannot be represented.
pub(crate) fn accept(target: f64, position: f64, velocity: f64, acceptance: &Acceptance) -> Option<AxisPlan> {
    let error = target - position;
    let plan = if velocity == 0.0 {
        let speed = acceptance.peak_speed * error.abs() / acceptance.distance;
        let arc = arc_from_rest(error, speed, acceptance.max_acceleration)?;
        with_arc(target, position, arc)
    } else if let Some(arc) = arc_in_passing(error, velocity, acceptance) {
        AxisPlan { start_velocity: velocity, ..with_arc(target, position, arc) }
    } else {
        let brake_time = velocity.abs() / acceptance.max_acceleration;
        let stop = position + 0.5 * velocity * brake_time;
        let error_then = target - stop;
        // An axis that has to come back from farther than the whole distance still keeps to v_max.
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

/// Position (m) and velocity (m/s) at a time `t >= 0` (s) after acceptance.
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

/// The arc from rest over `error`, with a peak speed of at most `speed`. No arc (amplitude 0) if there is no way to go.
fn arc_from_rest(error: f64, speed: f64, max_acceleration: f64) -> Option<Arc> {
    let length = error.abs();
    if length < NO_WAY_M {
        return Some(Arc::default());
    }
    let rate = (2.0 * speed / length).min((2.0 * max_acceleration / length).sqrt());
    // A rate that underflows to zero would never arrive.
    (rate > 0.0).then_some(Arc { amplitude: 0.5 * error, rate, phase: 0.0 })
}

/// The arc that passes here at this velocity, ends on the target at rest and does not overshoot.
///
/// `None` if there is none: moving away, nothing to go, or too fast to stop in time.
fn arc_in_passing(error: f64, velocity: f64, acceptance: &Acceptance) -> Option<Arc> {
    let length = error.abs();
    let towards = (error > 0.0) == (velocity > 0.0);
    if length < NO_WAY_M || !towards {
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
