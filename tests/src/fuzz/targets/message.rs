//! Messages of other processes: whatever bits they hold they are rejected, or used without harm.
//!
//! An input says which messages come, and which of their fields are spoilt how; they arrive one after the other at a stack in the
//! middle of a run, where each is used as the process that takes it does.

use super::change::changed;
use super::draw::Draw;
use super::fields::{Fields, spoil};
use super::stage::{Moment, PEAK, Stage};
use crate::fuzz::target::{FuzzOutcome, Target};
use hapfic_controller::control_step::{ControlInputs, control_step};
use hapfic_gate::protocol::{ControllerSlot, GateInputs, Observation};
use hapfic_log::viewer::Scene;
use hapfic_log::{Metrics, Names, Viewer, convert};
use hapfic_messages::{
    Check, Command, ControllerState, Credit, Detector, Event, EventKind, Mode, Operator, OperatorKind, OperatorReply,
    OperatorRequest, Phase, Process, Reference, ReplyCode, Request, Severity, State, Timing,
};
use hapfic_planner::Plan;
use std::path::Path;

pub(super) const TARGET: Target = Target { name: "message", seeds, dictionary: &[], text: false, longest: 1024, execute };

/// Most messages of an input.
const MOST: usize = 16;

fn seeds() -> Vec<Vec<u8>> {
    // Each kind of message in both moments: as it is, and with one field spoilt in different ways.
    let mut seeds = Vec::new();
    for moment in 0..2_u8 {
        for kind in 0..=255_u8 {
            seeds.push(vec![moment, kind, 1, kind.wrapping_mul(7), 1, kind, kind.wrapping_mul(31), 3]);
        }
        // State after state, as in a run.
        let mut states = vec![moment];
        states.resize(20, 0);
        seeds.push(states);
    }
    seeds
}

fn execute(input: &[u8], _: &Path) -> FuzzOutcome {
    Stage::with(|stage| {
        let mut draw = Draw::new(input);
        let moment = &stage.moments[draw.below(stage.moments.len())];
        let mut bench = Bench::new(stage, moment);
        let mut rejected = None;
        for _ in 0..MOST {
            if let Err(message) = bench.receive(&mut draw) {
                rejected.get_or_insert(message);
            }
            if draw.is_empty() {
                break;
            }
        }
        bench.sum_up();
        rejected.map_or(FuzzOutcome::Accepted, FuzzOutcome::Refused)
    })
}

/// A message with some fields changed.
fn spoilt<T: Fields>(mut message: T, draw: &mut Draw<'_>) -> T {
    spoil(&mut message, draw);
    message
}

/// Whether a message passes its check; if not, why.
fn checked(kind: &str, message: &impl Check) -> Result<(), String> {
    message.check().map_err(|defect| format!("{kind}: {defect}"))
}

struct Bench<'a> {
    stage: &'a Stage,
    names: &'a Names,
    moment: Moment,
    metrics: Metrics,
    viewer: Viewer,
    /// The last state that was taken.
    state: State,
    plan: Option<Plan>,
    /// The reference that a controller follows.
    reference: Reference,
    operator: Operator,
    /// Of the last command.
    previous_state: ControllerState,
    active: bool,
}

impl<'a> Bench<'a> {
    fn new(stage: &'a Stage, moment: &Moment) -> Self {
        let snapshot = &moment.snapshot;
        Self {
            stage,
            names: &stage.names,
            metrics: Metrics::new(),
            viewer: Viewer::new(Scene::default(), 60, 0),
            state: snapshot.state,
            plan: Some(Plan { tick: snapshot.reference.tick, state: snapshot.reference.planner }),
            reference: snapshot.reference,
            operator: snapshot.operator,
            previous_state: snapshot.command.request.state,
            active: true,
            moment: moment.clone(),
        }
    }

    fn receive(&mut self, draw: &mut Draw<'_>) -> Result<(), String> {
        let base = self.moment.snapshot;
        let next = self.state.tick.saturating_add(1);
        match draw.byte() % 16 {
            0..=3 => self.state(&spoilt(State { tick: next, ..base.state }, draw)),
            4 | 5 => self.reference(&spoilt(Reference { tick: next, ..base.reference }, draw)),
            6 | 7 => {
                let tick = self.moment.gate.tick();
                let parameters_version = self.operator.at(tick).version;
                let request = Request { tick, state_tick: tick, parameters_version, ..base.command.request };
                self.request(&spoilt(request, draw))
            }
            8 | 9 => {
                let tick = self.moment.plant.command_tick().saturating_add(1);
                self.command(&spoilt(Command { tick, ..base.command }, draw))
            }
            10 | 11 => self.operator(&spoilt(base.operator, draw)),
            12 => {
                let event = Event::new(
                    next,
                    Process::Planner,
                    EventKind::Lost,
                    Severity::Degraded,
                    Detector::Heartbeat,
                    "größer als ein Byte",
                );
                let event = spoilt(event, draw);
                let _ = convert::event(&event);
                let _ = event.text();
                checked("event", &event)
            }
            13 => {
                let (process, phase) = (Process::Supervisor.code(), Phase::Running.code());
                let timing =
                    Timing { process, phase, tick: next, due_ns: 10, wake_ns: 20, latency_ns: 50_000, ..Timing::default() };
                let timing = spoilt(Timing { publish_ns: 60_000, ..timing }, draw);
                self.metrics.push_timing(&convert::timing(&timing));
                checked("timing", &timing)
            }
            14 => {
                let request =
                    OperatorRequest::new(OperatorKind::Set, "stiffness.z=9000\0taper=0.1").map_err(|e| e.to_string())?;
                let request = spoilt(request, draw);
                let (_, text) = request.parts().map_err(|defect| format!("operator's request: {defect}"))?;
                changed(text)
            }
            _ => {
                checked("credit", &spoilt(Credit { tick: next }, draw))?;
                checked("operator's reply", &spoilt(OperatorReply::new(ReplyCode::Refused, "größer"), draw))
            }
        }
    }

    /// Planner, controller, gate and recorder take a state.
    fn state(&mut self, state: &State) -> Result<(), String> {
        let logged = convert::state(state, self.names);
        self.metrics.push_state(&logged);
        if self.viewer.due(state.tick) {
            let _ =
                self.viewer.scene_update(state.tick, &logged.contacts, Some(self.reference.position), Some(state.foot_position));
        }
        checked("state", state)?;
        if state.tick <= self.state.tick {
            return Err("state: an old tick".to_owned());
        }
        self.state = *state;
        let parameters = *self.operator.at(state.tick);
        let plan = Plan::next(self.plan, state, self.active, &self.operator);
        self.plan = Some(plan);
        let known = ControlInputs {
            state,
            reference_position: self.reference.position,
            reference_velocity: self.reference.velocity,
            parameters: &parameters,
            previous_state: self.previous_state,
        };
        let request = control_step(&self.stage.chain, &self.stage.gravity, &known, Process::Controller);
        // The planner's answer is for the tick after; nobody follows one that is no good.
        let reference = plan.reference(parameters.version);
        if reference.check().is_ok() {
            self.reference = reference;
        }
        let Some(request) = request else {
            self.miss();
            return Err("state: the controller has no answer".to_owned());
        };
        for (force, most) in request.force.iter().zip(&parameters.max_force) {
            assert!(force.abs() <= *most, "a force of {force} N beyond F_max, {most} N");
        }
        self.request(&request)
    }

    fn reference(&mut self, reference: &Reference) -> Result<(), String> {
        self.metrics.push_reference(&convert::reference(reference));
        checked("reference", reference)?;
        self.reference = *reference;
        // A planner that is started again goes on from here.
        self.plan = Some(Plan::resumed(reference));
        Ok(())
    }

    /// The gate takes a request.
    fn request(&mut self, request: &Request) -> Result<(), String> {
        let _ = convert::request(request);
        let gate = &mut self.moment.gate;
        let parameters = self.operator.at(gate.tick());
        if let Err(defect) = gate.validate(request, &self.state, parameters) {
            self.miss();
            return Err(format!("request: {defect}"));
        }
        let command = gate.accept(ControllerSlot::First, request, &Observation::alone(), &GateInputs::default());
        self.passed(&command);
        Ok(())
    }

    fn miss(&mut self) {
        let command = self.moment.gate.miss(&Observation { overdue: true, ..Observation::default() }, &GateInputs::default());
        self.passed(&command);
    }

    /// What the gate passes on is good, whatever came in.
    fn passed(&mut self, command: &Command) {
        assert_eq!(command.check(), Ok(()), "the gate passes on what everyone refuses");
        let within = command.torque.iter().all(|torque| torque.abs() <= PEAK);
        assert!(within, "the gate passes on {:?} N m, its peak is {PEAK} N m", command.torque);
        let _ = self.command(command);
    }

    /// Plant, planner and controllers take a command.
    fn command(&mut self, command: &Command) -> Result<(), String> {
        self.metrics.push_command(&convert::command(command));
        checked("command", command)?;
        self.previous_state = command.request.state;
        self.active = command.mode == Mode::Active.code();
        let plant = &mut self.moment.plant;
        if plant.take(command) {
            let advanced = plant.advance();
            assert!(
                advanced.is_ok(),
                "a command that was let pass: {}",
                advanced.err().map(|e| e.to_string()).unwrap_or_default()
            );
            assert_eq!(plant.sample().check(), Ok(()), "after a command that was let pass");
        }
        Ok(())
    }

    fn operator(&mut self, operator: &Operator) -> Result<(), String> {
        self.metrics.push_operator(&convert::operator(&operator.current));
        self.metrics.push_operator(&convert::operator(&operator.next));
        checked("operator", operator)?;
        self.operator = *operator;
        Ok(())
    }

    /// Figures are finite, whatever they are made from.
    fn sum_up(&self) {
        let figures = format!("{:?}", self.metrics.summary());
        let odd = figures.split(|c: char| !c.is_ascii_alphanumeric()).find(|word| matches!(*word, "NaN" | "inf"));
        assert_eq!(odd, None, "among the figures {figures}");
    }
}
