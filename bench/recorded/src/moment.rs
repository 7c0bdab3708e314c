//! Recorded ticks of a scenario.

use crate::RecordError;
use hapfic_config::{PERIOD_S, Settings};
use hapfic_controller::control_step::PreviousStates;
use hapfic_messages::{Command, Mode, Operator, Reference, State};
use hapfic_planner::TickPlan;
use hapfic_simulation::Simulation;

/// Inputs and outputs of the stack at a tick k.
#[derive(Clone, Copy, Debug)]
pub struct RecordedTick {
    /// state(k).
    pub state: State,
    /// reference(k).
    pub reference: Reference,
    /// Acceleration of the reference from tick k to k + 1, for controllers with feed-forward [m/s^2].
    pub reference_acceleration: [f64; 3],
    /// Parameter sets of the operator in request(k).
    pub operator: Operator,
    /// States of the controller in command(k - 1).
    pub previous: PreviousStates,
    /// Whether command(k - 1) put the drive under torque.
    pub active: bool,
    /// command(k), with the accepted request.
    pub command: Command,
}

impl RecordedTick {
    /// Returns whether the floor or an object pushes on the foot.
    #[must_use]
    pub fn in_contact(&self) -> bool {
        self.state.foot_force.iter().any(|force| *force != 0.0)
    }

    /// Returns the plan of reference(k).
    #[must_use]
    pub fn plan(&self) -> TickPlan {
        TickPlan::resumed(&self.reference)
    }
}

/// Returns `count` ticks of a scenario, evenly spread over its whole length.
///
/// # Errors
/// [`RecordError`] if the scenario does not exist, cannot be simulated, or has fewer ticks.
pub fn recorded_ticks(scenario: &str, count: u64) -> Result<Vec<RecordedTick>, RecordError> {
    let settings = Settings::load(scenario, &[])?;
    let ticks = settings.duration_ticks;
    if ticks < count.max(1) {
        return Err(RecordError::TooShort { scenario: scenario.to_owned(), found: ticks, expected: count.max(1) });
    }
    let every = ticks / count.max(1);
    let mut simulation = Simulation::new(&settings)?;
    let mut previous_command = simulation.snapshot().command;
    let mut recorded = Vec::with_capacity(count as usize);
    for tick in 0..count * every {
        let snapshot = *simulation.step()?;
        if tick % every == every - 1 {
            let active = previous_command.mode == Mode::Active.code();
            let plan = TickPlan::resumed(&snapshot.reference);
            let next = TickPlan::next(Some(plan), &snapshot.state, active, &snapshot.operator).reference(0);
            let acceleration = |axis: usize| (next.velocity[axis] - snapshot.reference.velocity[axis]) / PERIOD_S;
            recorded.push(RecordedTick {
                state: snapshot.state,
                reference: snapshot.reference,
                reference_acceleration: [acceleration(0), acceleration(1), acceleration(2)],
                operator: snapshot.operator,
                previous: PreviousStates::of(&previous_command.request),
                active,
                command: snapshot.command,
            });
        }
        previous_command = snapshot.command;
    }
    Ok(recorded)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_controller::control_step::{ControlInputs, ReferenceSetpoint, control_step};
    use hapfic_messages::{Process, Request};
    use hapfic_robot::Chain;

    #[test]
    fn recorded_ticks_floor_scenario_contains_air_and_contact() {
        let recorded = recorded_ticks("floor", 1000).unwrap();
        assert_eq!(recorded.len(), 1000);
        let touching = recorded.iter().filter(|m| m.in_contact()).count();
        assert!((500..900).contains(&touching), "{touching} of 1000 in contact");
        assert!(recorded.windows(2).all(|pair| pair[1].state.tick - pair[0].state.tick == 10));
    }

    #[test]
    fn recorded_tick_control_step_reproduces_request() {
        let settings = Settings::load("floor", &[]).unwrap();
        let chain = Chain::from_settings(&settings.robot).unwrap();
        for m in recorded_ticks("floor", 200).unwrap() {
            let inputs = ControlInputs {
                state: &m.state,
                setpoint: ReferenceSetpoint::of(&m.reference),
                parameters: m.operator.at(m.state.tick),
                previous: m.previous,
            };
            let gravity = settings.world.gravity_m_per_s2.into();
            let request = control_step(&chain, &gravity, &inputs, Process::Controller).unwrap();
            assert_eq!(request, Request { stamp_ns: 0, ..m.command.request });
        }
    }

    #[test]
    fn recorded_ticks_count_above_duration_is_rejected() {
        let error = recorded_ticks("floor", 1_000_000).unwrap_err().to_string();
        assert!(error.contains("10000 ticks") && error.contains("1000000"), "{error}");
    }
}
