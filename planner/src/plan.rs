//! One tick of the planner's process without its bus: from state(k) to the plan of tick k + 1.

use crate::{PlannerParameters, hold, setpoint, step};
use hapfic_config::PERIOD_S;
use hapfic_messages::{Operator, PlannerState, Reference, State};

/// Ticks by which a plan may lag behind and still be stepped through; beyond, the motion starts anew from where it is held.
const CATCH_UP: i64 = 4;

/// A plan and the tick it is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// The tick.
    pub tick: i64,
    /// The planner's state at it.
    pub state: PlannerState,
}

impl Plan {
    /// A reference that rests where the foot is, for a tick.
    #[must_use]
    pub fn at_rest(tick: i64, foot_position: [f64; 3]) -> Self {
        Self { tick, state: hold(foot_position) }
    }

    /// The plan that a reference was made from: the planner's whole state travels in it.
    #[must_use]
    pub fn resumed(reference: &Reference) -> Self {
        Self { tick: reference.tick, state: reference.planner }
    }

    /// The plan of the tick after `state`, from the one before, if there is one.
    ///
    /// `active`: whether the command of the tick before puts the drive under torque. While it does not (before the first command,
    /// and braking) the reference is where the foot is.
    #[must_use]
    pub fn next(before: Option<Self>, state: &State, active: bool, operator: &Operator) -> Self {
        let tick = state.tick.saturating_add(1);
        match before {
            Some(plan) if active && tick.saturating_sub(plan.tick) <= CATCH_UP => plan.advanced(tick, operator),
            Some(plan) if active => {
                // Long away: the controllers have held the last position since.
                Self::at_rest(state.tick, setpoint(&plan.state, PERIOD_S).position_m).advanced(tick, operator)
            }
            _ => Self::at_rest(tick, state.foot_position),
        }
    }

    /// The message, without a stamp.
    #[must_use]
    pub fn reference(&self, parameters_version: u64) -> Reference {
        let out = setpoint(&self.state, PERIOD_S);
        Reference {
            stamp_ns: 0,
            tick: self.tick,
            parameters_version,
            position: out.position_m,
            velocity: out.velocity_m_per_s,
            planner: self.state,
        }
    }

    /// Stepped up to a tick, each tick with the parameters in force at it.
    fn advanced(mut self, tick: i64, operator: &Operator) -> Self {
        while self.tick < tick {
            let p = operator.at(self.tick + 1);
            let parameters =
                PlannerParameters { mean_speed_m_per_s: p.mean_speed, max_acceleration_m_per_s2: p.max_acceleration };
            self.state = step(self.state, p.target_position, &parameters, PERIOD_S).0;
            self.tick += 1;
        }
        self
    }
}
