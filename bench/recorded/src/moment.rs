//! Single ticks of a scenario.

use crate::RecordError;
use hapfic_config::{PERIOD_S, Settings};
use hapfic_messages::{Command, ControllerState, Mode, Operator, Reference, State};
use hapfic_planner::Plan;
use hapfic_simulation::Simulation;

/// What the stack knew at a tick k, and what it made of it.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// state(k).
    pub state: State,
    /// reference(k).
    pub reference: Reference,
    /// Acceleration of the reference from tick k to k + 1, m/s^2: controllers that want one feed it forward.
    pub reference_acceleration: [f64; 3],
    /// The operator's sets as they were known when tick k was answered.
    pub operator: Operator,
    /// The controller's state as command(k - 1) carries it.
    pub previous_state: ControllerState,
    /// Whether command(k - 1) put the drive under torque.
    pub active: bool,
    /// command(k), with the request it accepted.
    pub command: Command,
}

impl Moment {
    /// Whether the floor or an object pushes on the foot.
    #[must_use]
    pub fn in_contact(&self) -> bool {
        self.state.foot_force.iter().any(|force| *force != 0.0)
    }

    /// The plan that reference(k) was made from.
    #[must_use]
    pub fn plan(&self) -> Plan {
        Plan::resumed(&self.reference)
    }
}

/// `count` moments of a scenario, evenly spread over its whole length.
///
/// # Errors
/// [`RecordError`] if there is no such scenario, it cannot be simulated, or has fewer ticks.
pub fn moments(scenario: &str, count: u64) -> Result<Vec<Moment>, RecordError> {
    let settings = Settings::load(scenario, &[])?;
    let ticks = settings.duration_ticks;
    if ticks < count.max(1) {
        return Err(RecordError::TooShort { scenario: scenario.to_owned(), found: ticks, expected: count.max(1) });
    }
    let every = ticks / count.max(1);
    let mut simulation = Simulation::new(&settings)?;
    let mut before = simulation.snapshot().command;
    let mut moments = Vec::with_capacity(count as usize);
    for tick in 0..count * every {
        let made = *simulation.step()?;
        if tick % every == every - 1 {
            let active = before.mode == Mode::Active.code();
            let plan = Plan::resumed(&made.reference);
            let next = Plan::next(Some(plan), &made.state, active, &made.operator).reference(0);
            let gained = |axis: usize| (next.velocity[axis] - made.reference.velocity[axis]) / PERIOD_S;
            moments.push(Moment {
                state: made.state,
                reference: made.reference,
                reference_acceleration: [gained(0), gained(1), gained(2)],
                operator: made.operator,
                previous_state: before.request.state,
                active,
                command: made.command,
            });
        }
        before = made.command;
    }
    Ok(moments)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_controller::control_step::{ControlInputs, control_step};
    use hapfic_messages::{Process, Request};
    use hapfic_robot::Chain;

    #[test]
    fn the_floor_scenario_is_told_with_and_without_contact() {
        let moments = moments("floor", 1000).unwrap();
        assert_eq!(moments.len(), 1000);
        let touching = moments.iter().filter(|m| m.in_contact()).count();
        assert!((500..900).contains(&touching), "{touching} of 1000 in contact");
        assert!(moments.windows(2).all(|pair| pair[1].state.tick - pair[0].state.tick == 10));
    }

    #[test]
    fn a_moment_has_all_that_the_answer_was_made_from() {
        let settings = Settings::load("floor", &[]).unwrap();
        let chain = Chain::from_settings(&settings.robot).unwrap();
        for m in moments("floor", 200).unwrap() {
            let known = ControlInputs {
                state: &m.state,
                reference_position: m.reference.position,
                reference_velocity: m.reference.velocity,
                parameters: m.operator.at(m.state.tick),
                previous_state: m.previous_state,
            };
            let gravity = settings.world.gravity_m_per_s2.into();
            let request = control_step(&chain, &gravity, &known, Process::Controller).unwrap();
            assert_eq!(request, Request { stamp_ns: 0, ..m.command.request });
        }
    }

    #[test]
    fn more_moments_than_ticks_are_refused() {
        let error = moments("floor", 1_000_000).unwrap_err().to_string();
        assert!(error.contains("10000 ticks") && error.contains("1000000"), "{error}");
    }
}
