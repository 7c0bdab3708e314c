//! The planner of the three axes: state in, state and setpoint out.

use crate::axis::{self, Acceptance};
use hapfic_messages::PlannerState;

/// Peak speed of a harmonic trajectory over its desired mean speed (the paper's ratio).
pub const PEAK_TO_MEAN: f64 = 1.596;

/// Coordinates beyond this are rejected as if they were not finite, m: it keeps every product in the plan representable.
const LARGEST_COORDINATE_M: f64 = 1e100;

/// How fast the reference may move. Counts for the next accepted target, never for the one under way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannerParameters {
    /// Desired mean speed, m/s, > 0. The peak speed is v_max = [`PEAK_TO_MEAN`] times this. Raise it to arrive sooner.
    pub mean_speed_m_per_s: f64,
    /// a_max, m/s^2, > 0: the largest acceleration of the reference on any axis. Raise it to allow short, sharp motions.
    pub max_acceleration_m_per_s2: f64,
}

/// Where the reference is, world frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setpoint {
    /// x_d, m.
    pub position_m: [f64; 3],
    /// x_d', m/s.
    pub velocity_m_per_s: [f64; 3],
}

/// The state of a reference that rests at `position`, m, finite.
#[must_use]
pub fn hold(position: [f64; 3]) -> PlannerState {
    PlannerState { ticks: 0, axes: position.map(axis::rest) }
}

/// Where the reference is in this state; `period_s` is the control tick, s, finite and > 0.
///
/// With a period that is not, the time since acceptance counts as zero.
#[must_use]
pub fn setpoint(state: &PlannerState, period_s: f64) -> Setpoint {
    let t = if is_positive(period_s) { state.ticks as f64 * period_s } else { 0.0 };
    let at = state.axes.map(|plan| axis::evaluate(&plan, t));
    Setpoint { position_m: at.map(|(position, _)| position), velocity_m_per_s: at.map(|(_, velocity)| velocity) }
}

/// One control tick: accepts `target` (m, world frame) if it differs from the one under way, then advances by `period_s`.
///
/// The state after tick k and its setpoint are those of tick k + 1. A target is accepted from the position and velocity
/// of tick k; all three axes are planned anew, also those whose coordinate stays, since the distance is shared.
/// From rest the path is straight, unless a_max limits an axis: then that axis alone takes longer.
/// An axis whose arc would need more than a_max brakes first. So a target that changes at every tick is followed slowly:
/// give targets as way points, not as a stream.
///
/// A target that is not finite (or beyond 1e100 m), a speed or an acceleration that is not finite and positive change
/// nothing: the plan under way goes on. With a period that is not finite and positive the state does not advance.
#[must_use]
pub fn step(state: PlannerState, target: [f64; 3], p: &PlannerParameters, period_s: f64) -> (PlannerState, Setpoint) {
    let mut next = state;
    if is_positive(period_s) {
        let active = state.axes.map(|plan| plan.target);
        if target != active {
            next = accept(target, &setpoint(&state, period_s), p).unwrap_or(state);
        }
        next.ticks = next.ticks.saturating_add(1);
    }
    (next, setpoint(&next, period_s))
}

/// A plan from `now` to `target`; `None` if target or parameters are unusable.
fn accept(target: [f64; 3], now: &Setpoint, p: &PlannerParameters) -> Option<PlannerState> {
    let representable = target.iter().chain(&now.position_m).all(|x| x.abs() <= LARGEST_COORDINATE_M);
    let peak_speed = PEAK_TO_MEAN * p.mean_speed_m_per_s;
    if !representable || !is_positive(peak_speed) || !is_positive(p.max_acceleration_m_per_s2) {
        return None;
    }
    let [x, y, z] = [0_usize, 1, 2].map(|i| target[i] - now.position_m[i]);
    let acceptance = Acceptance { peak_speed, max_acceleration: p.max_acceleration_m_per_s2, distance: x.hypot(y).hypot(z) };
    let plan = |i: usize| axis::accept(target[i], now.position_m[i], now.velocity_m_per_s[i], &acceptance);
    Some(PlannerState { ticks: 0, axes: [plan(0)?, plan(1)?, plan(2)?] })
}

fn is_positive(value: f64) -> bool {
    value.is_finite() && value > 0.0
}
