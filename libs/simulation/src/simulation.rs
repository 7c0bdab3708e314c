//! The stack in one process, without buses, clocks or threads: plant, planner, controller, gate and operator.
//!
//! A tick calls the same functions as the processes in lockstep, in the same order. The messages are therefore the
//! same, bit for bit; stamps are zero in both. Studies, checks and searches over parameters use it.

use hapfic_config::{OperatorChange, Settings};
use hapfic_controller::control_step::{ControlInputs, PreviousStates, ReferenceSetpoint, control_step};
use hapfic_controller::parameters::TipPose;
use hapfic_gate::parameter_schedule::ParameterSchedule;
use hapfic_gate::protocol::{ControllerSlot, GateInputs, Observation};
use hapfic_gate::torque_check::TorqueCheck;
use hapfic_gate::{Gate, GateLimits};
use hapfic_messages::{Command, MAX_JOINTS, Mode, Operator, Process, Reference, State, ValidationError};
use hapfic_planner::TickPlan;
use hapfic_plant::{Plant, PlantError};
use hapfic_robot::{Chain, JointVector, cholesky};
use nalgebra::Vector3;

/// Dead time from a state to the torque that answers it [ticks].
///
/// The stack has [`DeadTime::One`]; the others are for studies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeadTime {
    /// The torque acts from its own state on; no real drive can do this.
    None,
    /// The torque acts from the next tick on.
    #[default]
    One,
    /// The torque acts two ticks later: a fault, as all that follow.
    Two,
    /// Three ticks later.
    Three,
    /// Four ticks later.
    Four,
    /// Five ticks later.
    Five,
}

impl DeadTime {
    /// All dead times.
    pub const ALL: [Self; 6] = [Self::None, Self::One, Self::Two, Self::Three, Self::Four, Self::Five];
}

/// Messages of a tick k.
#[derive(Clone, Copy, Debug)]
pub struct Snapshot {
    /// state(k).
    pub state: State,
    /// reference(k).
    pub reference: Reference,
    /// command(k), with the request it accepted.
    pub command: Command,
    /// The operator's sets at the answer of tick k; [`Operator::at`] k is the set in force.
    pub operator: Operator,
}

/// An error that ends a simulation.
#[derive(Debug, thiserror::Error)]
pub enum SimulationError {
    /// The plant cannot be built, or left the finite numbers.
    #[error(transparent)]
    Plant(#[from] PlantError),
    /// The control step of a state gave no request.
    #[error("tick {tick}: found no request of the controller, expected one; its numbers have overflowed: lower the gains")]
    NoRequest {
        /// The tick.
        tick: i64,
    },
    /// The gate rejected the controller's request.
    #[error("tick {tick}: the gate rejected the controller's request: {error}; lower the gains")]
    Rejected {
        /// The tick.
        tick: i64,
        /// The reason.
        error: ValidationError,
    },
}

/// State of the stack between two ticks. A clone continues independently.
#[derive(Clone, Debug)]
pub struct Simulation {
    plant: Plant,
    chain: Chain,
    gravity: Vector3<f64>,
    gate: Gate,
    schedule: ParameterSchedule,
    /// The planner's plan; `None` before the first tick.
    plan: Option<TickPlan>,
    dead_time: DeadTime,
    /// command(k - 1) to command(k - 5), for the tick k to come.
    commands: [Command; 5],
    snapshot: Snapshot,
}

impl Simulation {
    /// Creates the stack of a scenario, with its real dead time.
    ///
    /// # Errors
    /// [`SimulationError::Plant`] if the robot description or the start posture is invalid.
    pub fn new(settings: &Settings) -> Result<Self, SimulationError> {
        Self::with_dead_time(settings, DeadTime::default())
    }

    /// Creates the stack of a scenario with a given dead time.
    ///
    /// # Errors
    /// As for [`new`](Self::new).
    pub fn with_dead_time(settings: &Settings, dead_time: DeadTime) -> Result<Self, SimulationError> {
        let plant = Plant::new(settings)?;
        let gate = Gate::new(
            GateLimits::new(settings, plant.chain()),
            TorqueCheck::new(plant.chain().clone(), settings.world.gravity_m_per_s2),
        );
        let state = plant.sample();
        let mut schedule = ParameterSchedule::new(settings, TipPose::of(&plant.chain().kinematics(&state.joint_position)));
        schedule.announce(-1);
        let first = *gate.last();
        Ok(Self {
            chain: plant.chain().clone(),
            gravity: Vector3::from(settings.world.gravity_m_per_s2),
            plan: None,
            dead_time,
            commands: [first; 5],
            snapshot: Snapshot { state, reference: Reference::default(), command: first, operator: *schedule.operator() },
            plant,
            gate,
            schedule,
        })
    }

    /// Tick of the next [`step`](Self::step).
    #[must_use]
    pub fn tick(&self) -> i64 {
        self.gate.tick()
    }

    /// The plant, to inspect or set its state between two ticks.
    #[must_use]
    pub fn plant(&mut self) -> &mut Plant {
        &mut self.plant
    }

    /// Gives the tip an impulse [N s], world frame: the joints change their speed by `M^-1 J^T p`, as after a short blow.
    pub fn push_tip(&mut self, impulse: &Vector3<f64>) {
        let chain = self.plant.chain();
        let kin = chain.kinematics(&self.plant.sample().joint_position);
        let n = chain.dof();
        let mut root: [JointVector; MAX_JOINTS] = chain.mass_matrix(&kin).into();
        let mut change = chain.jacobian(&kin).linear_transpose_mul(impulse);
        // Positive definite at every posture: the description was checked.
        if cholesky::factor(&mut root, n) {
            cholesky::substitute(&root, &mut change, n);
            self.plant.kick(&change);
        }
    }

    /// Messages of the last tick; before the first tick, the initial state and command.
    #[must_use]
    pub fn snapshot(&self) -> &Snapshot {
        &self.snapshot
    }

    /// The operator's sets after the last tick, with those announced in it.
    #[must_use]
    pub fn operator(&self) -> &Operator {
        self.schedule.operator()
    }

    /// Adds a change of the operator, with effect from the earliest possible tick.
    ///
    /// Returns its version and that tick; `None` if too many changes are pending.
    pub fn change(&mut self, change: &OperatorChange) -> Option<(u64, i64)> {
        self.schedule.insert(change, self.gate.tick())
    }

    /// Advances by one tick. The caller limits the duration.
    ///
    /// # Errors
    /// [`SimulationError`]; the simulation is invalid from then on.
    pub fn step(&mut self) -> Result<&Snapshot, SimulationError> {
        let tick = self.gate.tick();
        let state = self.plant.sample();
        let operator = *self.schedule.operator();
        let reference = self.take_reference(&state, &operator);
        let inputs = ControlInputs {
            state: &state,
            setpoint: ReferenceSetpoint::of(&reference),
            parameters: operator.at(tick),
            previous: PreviousStates::of(&self.commands[0].request),
        };
        let request =
            control_step(&self.chain, &self.gravity, &inputs, Process::Controller).ok_or(SimulationError::NoRequest { tick })?;
        self.gate.validate(&request, &state, operator.at(tick)).map_err(|error| SimulationError::Rejected { tick, error })?;
        let command = self.gate.accept(ControllerSlot::First, &request, &Observation::alone(), &GateInputs::default());
        self.schedule.announce(tick);
        self.drive(tick, &command);
        self.plant.advance()?;
        self.commands.rotate_right(1);
        self.commands[0] = command;
        self.snapshot = Snapshot { state, reference, command, operator };
        Ok(&self.snapshot)
    }

    /// Planner tick: returns reference(k) and makes the plan of k + 1.
    fn take_reference(&mut self, state: &State, operator: &Operator) -> Reference {
        // Versions as in the planner: reference(k) is made at k - 1, that of tick 0 together with that of tick 1.
        let version = operator.at(state.tick.max(1)).version;
        let plan = self.plan.unwrap_or_else(|| TickPlan::at_rest(0, state, operator.at(0).is_pose()));
        let active = self.commands[0].mode == Mode::Active.code();
        self.plan = Some(TickPlan::next(Some(plan), state, active, operator));
        plan.reference(version)
    }

    /// Passes the command that is due to the drive.
    fn drive(&mut self, tick: i64, now: &Command) {
        let due = match self.dead_time {
            DeadTime::None => now,
            late => &self.commands[late as usize - 1],
        };
        // The drive expects a dead time of one tick and counts missing commands by their ticks.
        self.plant.take(&Command { tick: tick - 1, ..*due });
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn settings() -> Settings {
        Settings::load("floor", &[]).unwrap()
    }

    #[test]
    fn simulation_ticks_match_processes() {
        let mut simulation = Simulation::new(&settings()).unwrap();
        assert_eq!(simulation.snapshot().command.mode, Mode::Hold.code());
        for k in 0..300 {
            assert_eq!(simulation.tick(), k);
            let s = *simulation.step().unwrap();
            assert_eq!((s.state.tick, s.reference.tick, s.command.tick, s.command.request.state_tick), (k, k, k, k));
            assert_eq!(s.state.command_tick, (k - 2).max(-1), "the command that acted until the state");
            assert_eq!(s.command.mode, Mode::Active.code());
            assert_eq!(s.operator.at(k).version, s.command.request.parameters_version);
        }
        assert_eq!(simulation.snapshot().operator.at(299).version, 2, "the first change is at 0.2 s");
    }

    #[test]
    fn simulation_before_first_torque_brakes_hold() {
        for (dead_time, held) in [(DeadTime::None, 0), (DeadTime::One, 1), (DeadTime::Two, 2)] {
            let mut simulation = Simulation::with_dead_time(&settings(), dead_time).unwrap();
            let start = simulation.snapshot().state.joint_position;
            let mut moved = None;
            for k in 0..6 {
                let state = simulation.step().unwrap().state;
                if moved.is_none() && state.joint_position != start {
                    moved = Some(k);
                }
            }
            // A torque that acts from tick `held` on changes the state after it.
            assert_eq!(moved, Some(held + 1), "{dead_time:?}");
        }
    }

    #[test]
    fn simulation_change_acts_at_returned_tick() {
        let mut simulation = Simulation::new(&settings()).unwrap();
        for _ in 0..10 {
            simulation.step().unwrap();
        }
        let change = OperatorChange { taper: Some(0.1), ..OperatorChange::default() };
        let (version, from) = simulation.change(&change).unwrap();
        for k in 10..30 {
            let s = simulation.step().unwrap();
            let set = s.operator.at(k);
            assert_eq!((set.taper, set.version), if k < from { (0.4, version - 1) } else { (0.1, version) }, "tick {k}");
        }
        assert!((10..30).contains(&from));
    }

    #[test]
    fn simulation_same_settings_give_same_bits() {
        let settings = settings();
        let (mut a, mut b) = (Simulation::new(&settings).unwrap(), Simulation::new(&settings).unwrap());
        for _ in 0..400 {
            let (a, b) = (a.step().unwrap(), b.step().unwrap());
            assert_eq!(a.command.torque.map(f64::to_bits), b.command.torque.map(f64::to_bits));
            assert_eq!(a.state, b.state);
        }
    }
}
