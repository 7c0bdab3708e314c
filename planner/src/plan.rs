//! Tick of the planner's process without its bus: from state(k) to the plan of tick k + 1.

use crate::{PlannerParameters, hold, rotation, setpoint, step};
use hapfic_config::PERIOD_S;
use hapfic_messages::{Operator, PlannerState, Reference, RotationPlan, State};

/// Largest lag of a plan that the planner steps through [ticks]; beyond it the motion restarts from the held position.
const MAX_CATCH_UP: i64 = 4;

/// A plan with its tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TickPlan {
    /// Tick of the plan.
    pub tick: i64,
    /// State of the planner at that tick.
    pub state: PlannerState,
}

impl TickPlan {
    /// Returns a plan at rest on the pose of the foot.
    ///
    /// A `pose` task also holds the orientation; otherwise the plan has none.
    #[must_use]
    pub fn at_rest(tick: i64, state: &State, pose: bool) -> Self {
        let rotation = if pose { rotation::hold(&state.foot_orientation) } else { RotationPlan::default() };
        Self { tick, state: PlannerState { rotation, ..hold(state.foot_position) } }
    }

    /// Returns the plan behind a reference, which carries the planner's whole state.
    #[must_use]
    pub fn resumed(reference: &Reference) -> Self {
        Self { tick: reference.tick, state: reference.planner }
    }

    /// Returns the plan of the tick after `state`, from the previous plan if there is one.
    ///
    /// `active`: whether the command of the previous tick puts the drive under torque. While it does not (before the
    /// first command, and while braking) the reference is the position of the foot.
    #[must_use]
    pub fn next(before: Option<Self>, state: &State, active: bool, operator: &Operator) -> Self {
        let tick = state.tick.saturating_add(1);
        let pose = operator.at(tick).is_pose();
        match before {
            Some(plan) if active && tick.saturating_sub(plan.tick) <= MAX_CATCH_UP => plan.advanced(tick, operator),
            Some(plan) if active => {
                // After a long gap the motion restarts from the last pose, which the controllers have held.
                let rotation = if pose { rotation::held(&plan.state.rotation, PERIOD_S) } else { RotationPlan::default() };
                let held = PlannerState { rotation, ..hold(setpoint(&plan.state, PERIOD_S).position_m) };
                Self { tick: state.tick, state: held }.advanced(tick, operator)
            }
            _ => Self::at_rest(tick, state, pose),
        }
    }

    /// Returns the message, without a stamp.
    #[must_use]
    pub fn reference(&self, parameters_version: u64) -> Reference {
        let out = setpoint(&self.state, PERIOD_S);
        let (orientation, angular_velocity) = rotation::setpoint(&self.state.rotation, PERIOD_S);
        Reference {
            stamp_ns: 0,
            tick: self.tick,
            parameters_version,
            limbs: 1,
            reserved: 0,
            orientation,
            angular_velocity,
            position: out.position_m,
            velocity: out.velocity_m_per_s,
            planner: self.state,
        }
    }

    /// Steps the plan up to a tick, each tick with its parameters.
    fn advanced(mut self, tick: i64, operator: &Operator) -> Self {
        while self.tick < tick {
            let p = operator.at(self.tick + 1);
            let parameters =
                PlannerParameters { mean_speed_m_per_s: p.mean_speed, max_acceleration_m_per_s2: p.max_acceleration };
            self.state = step(self.state, p.target_position, &parameters, PERIOD_S).0;
            if p.is_pose() {
                self.state.rotation = rotation::step(self.state.rotation, &p.rotation, PERIOD_S);
            }
            self.tick += 1;
        }
        self
    }
}
