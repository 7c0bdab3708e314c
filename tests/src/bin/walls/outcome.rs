//! Outcome of a case: figures of its simulation.

use crate::case::{Case, STEP_TICK, TICKS};
use hapfic_config::Settings;
use hapfic_messages::TaskCondition;
use hapfic_simulation::conditions::TaskWatch;
use hapfic_simulation::{DeadTime, Simulation};

/// Ticks at the end over which the settled error counts: 0.5 s.
const SETTLED_TICKS: i64 = 500;
/// Band about F_d in which the force has settled, as a share of F_d.
const BAND: f64 = 0.02;

/// Figures of a case.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Outcome {
    /// Whether F_d is within reach.
    pub(crate) within_reach: bool,
    /// Root of the mean square of F - F_d in the last 0.5 s, share of F_d; F without the sensor's noise.
    pub(crate) settled: f64,
    /// Time from the step until the force stays within 2 % of F_d [s]; infinite if it does not.
    pub(crate) settling_s: f64,
    /// Largest force beyond F_d after it was first reached [N].
    pub(crate) beyond_n: f64,
    /// Largest force before the step, the landing [N].
    pub(crate) impact_n: f64,
    /// Largest |F_c| / F_max.
    pub(crate) share_of_limit: f64,
    /// Time from the step until an oscillation of the force is told [s]; infinite if it is not.
    pub(crate) told_s: f64,
}

/// Simulates a case.
pub(crate) fn outcome(case: &Case) -> Result<Outcome, String> {
    outcome_with(case, &case.settings(), DeadTime::default())
}

/// Simulates a case under changed settings, with a dead time.
pub(crate) fn outcome_with(case: &Case, settings: &Settings, dead_time: DeadTime) -> Result<Outcome, String> {
    let failed = |error: hapfic_simulation::SimulationError| format!("{case:?}: {error}");
    let mut simulation = Simulation::with_dead_time(settings, dead_time).map_err(failed)?;
    let mut watch = TaskWatch::new(settings, simulation.plant().chain().clone());
    let oscillates = TaskCondition::ForceOscillates.name();
    let mut out = Outcome { within_reach: case.within_reach(settings), told_s: f64::INFINITY, ..Outcome::default() };
    let (mut last_outside, mut first_side, mut reached, mut square) = (STEP_TICK, 0.0_f64, false, 0.0);
    for tick in 0..TICKS {
        let snapshot = simulation.step().map_err(failed)?;
        let (state, request) = (&snapshot.state, &snapshot.command.request);
        let events = watch.push(state, &snapshot.reference, &snapshot.command, snapshot.operator.at(tick));
        // The true force: the sensor's may have noise.
        let force: f64 = state.contacts[..state.contact_count as usize].iter().map(|contact| contact.force[2]).sum();
        for (force, limit) in request.force.iter().zip(settings.initial.max_force) {
            out.share_of_limit = out.share_of_limit.max(force.abs() / limit);
        }
        if tick < STEP_TICK {
            out.impact_n = out.impact_n.max(force);
            continue;
        }
        if events.iter().any(|event| event.text().starts_with(oscillates)) {
            out.told_s = out.told_s.min((tick - STEP_TICK) as f64 * 1e-3);
        }
        let error = force - case.force;
        if first_side == 0.0 {
            first_side = error.signum();
        }
        reached |= error * first_side <= 0.0;
        if reached {
            out.beyond_n = out.beyond_n.max(-error * first_side);
        }
        if error.abs() > BAND * case.force {
            last_outside = tick + 1;
        }
        if tick >= TICKS - SETTLED_TICKS {
            square += error * error;
        }
    }
    out.settled = (square / SETTLED_TICKS as f64).sqrt() / case.force;
    out.settling_s = if last_outside >= TICKS { f64::INFINITY } else { (last_outside - STEP_TICK) as f64 * 1e-3 };
    Ok(out)
}
