//! Planner of the three axes: state in, state and setpoint out.

use crate::harmonic_arc::{self as arc, Acceptance};
use hapfic_messages::{AxisPlan, PlannerState};

/// Peak speed of a harmonic trajectory over its desired mean speed (the paper's ratio).
pub const PEAK_TO_MEAN: f64 = 1.596;

/// Largest valid coordinate [m]; it keeps every product in the plan representable.
const LARGEST_COORDINATE_M: f64 = 1e100;

/// Limits of the reference's motion. They apply to the next accepted target, never to the active one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannerParameters {
    /// Desired mean speed [m/s], > 0. The peak speed v_max is [`PEAK_TO_MEAN`] times this. Raising it shortens the
    /// motion.
    pub mean_speed_m_per_s: f64,
    /// Largest acceleration a_max of the reference on any axis [m/s^2], > 0. Raising it allows short, sharp motions.
    pub max_acceleration_m_per_s2: f64,
}

/// Position and velocity of the reference, world frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setpoint {
    /// x_d [m].
    pub position_m: [f64; 3],
    /// x_d' [m/s].
    pub velocity_m_per_s: [f64; 3],
}

/// Returns the state of a reference at rest on `position` [m], finite.
#[must_use]
pub fn hold(position: [f64; 3]) -> PlannerState {
    PlannerState { ticks: 0, axes: position.map(arc::rest), ..PlannerState::default() }
}

/// Returns the setpoint of a state; `period_s` is the control tick [s], finite and > 0.
///
/// With an invalid period the time since acceptance counts as zero.
#[must_use]
pub fn setpoint(state: &PlannerState, period_s: f64) -> Setpoint {
    let t = if is_positive(period_s) { state.ticks as f64 * period_s } else { 0.0 };
    let at = state.axes.map(|plan| arc::evaluate(&plan, t));
    Setpoint { position_m: at.map(|(position, _)| position), velocity_m_per_s: at.map(|(_, velocity)| velocity) }
}

/// Runs one control tick: accepts `target` in the world frame [m] if it differs from the active one, then advances by
/// `period_s` [s].
///
/// The state after tick k and its setpoint are those of tick k + 1. Acceptance starts from the position and velocity of
/// tick k. It plans all three axes again, also an axis whose coordinate stays, because the axes share the distance.
/// From rest the path is straight, unless a_max limits an axis: then that axis alone takes longer.
/// An axis whose arc needs more than a_max brakes first. The reference therefore follows a target that changes at every
/// tick slowly: targets are way points, not a stream.
///
/// The active plan continues after an invalid input: a target that is not finite or beyond 1e100 m, or a speed or an
/// acceleration that is not finite and positive. With an invalid period the state does not advance.
#[must_use]
pub fn step(state: PlannerState, target: [f64; 3], p: &PlannerParameters, period_s: f64) -> (PlannerState, Setpoint) {
    let mut next = state;
    if is_positive(period_s) {
        let active = state.axes.map(|plan| plan.target);
        if target != active {
            next = accept(target, &setpoint(&state, period_s), p).map_or(state, |axes| PlannerState {
                ticks: 0,
                axes,
                rotation: state.rotation,
            });
        }
        next.ticks = next.ticks.saturating_add(1);
    }
    (next, setpoint(&next, period_s))
}

/// Plans the motion from `now` to `target`; `None` if target or parameters are invalid.
pub(crate) fn accept(target: [f64; 3], now: &Setpoint, p: &PlannerParameters) -> Option<[AxisPlan; 3]> {
    let representable = target.iter().chain(&now.position_m).all(|x| x.abs() <= LARGEST_COORDINATE_M);
    let peak_speed = PEAK_TO_MEAN * p.mean_speed_m_per_s;
    if !representable || !is_positive(peak_speed) || !is_positive(p.max_acceleration_m_per_s2) {
        return None;
    }
    let [x, y, z] = [0_usize, 1, 2].map(|i| target[i] - now.position_m[i]);
    let acceptance = Acceptance { peak_speed, max_acceleration: p.max_acceleration_m_per_s2, distance: x.hypot(y).hypot(z) };
    let plan = |i: usize| arc::accept(target[i], now.position_m[i], now.velocity_m_per_s[i], &acceptance);
    Some([plan(0)?, plan(1)?, plan(2)?])
}

fn is_positive(value: f64) -> bool {
    value.is_finite() && value > 0.0
}
