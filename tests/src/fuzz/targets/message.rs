//! Target `message`: messages of other processes. Whatever their bits, each is rejected, or used without harm.
//!
//! An input selects the messages, and how their fields are corrupted. They arrive one after the other at a stack in the
//! middle of a run, and each is used as its receiving process does.

use super::change::changed;
use super::draw::Sampler;
use super::fields::{FieldAccess, corrupt};
use super::stage::{PEAK, StackFixture, StackSnapshot};
use crate::fuzz::target::{FuzzOutcome, FuzzTarget};
use hapfic_controller::control_step::{ControlInputs, PreviousStates, ReferenceSetpoint, control_step};
use hapfic_gate::protocol::{ControllerSlot, GateInputs, Observation};
use hapfic_log::viewer::ViewerScene;
use hapfic_log::{Metrics, Names, Viewer, convert};
use hapfic_messages::{
    Check, Command, Credit, Detector, Event, EventKind, Mode, Operator, OperatorKind, OperatorReply, OperatorRequest, Phase,
    Process, Reference, ReplyCode, Request, Severity, State, Timing,
};
use hapfic_planner::TickPlan;
use std::path::Path;

pub(super) const TARGET: FuzzTarget =
    FuzzTarget { name: "message", seeds, dictionary: &[], text: false, max_bytes: 1024, execute };

/// Largest number of messages of an input.
const MAX_MESSAGES: usize = 16;

fn seeds() -> Vec<Vec<u8>> {
    // Each kind of message in both snapshots, with one field corrupted in different ways.
    let mut seeds = Vec::new();
    for snapshot in 0..2_u8 {
        for kind in 0..=255_u8 {
            seeds.push(vec![snapshot, kind, 1, kind.wrapping_mul(7), 1, kind, kind.wrapping_mul(31), 3]);
        }
        // State after state, as in a run.
        let mut states = vec![snapshot];
        states.resize(20, 0);
        seeds.push(states);
    }
    seeds
}

fn execute(input: &[u8], _: &Path) -> FuzzOutcome {
    StackFixture::with(|fixture| {
        let mut sampler = Sampler::new(input);
        let snapshot = &fixture.snapshots[sampler.below(fixture.snapshots.len())];
        let mut stack = StackUnderTest::new(fixture, snapshot);
        let mut rejected = None;
        for _ in 0..MAX_MESSAGES {
            if let Err(message) = stack.receive(&mut sampler) {
                rejected.get_or_insert(message);
            }
            if sampler.is_empty() {
                break;
            }
        }
        stack.check_metrics();
        rejected.map_or(FuzzOutcome::Accepted, FuzzOutcome::Rejected)
    })
}

/// Returns a message with some fields corrupted.
fn corrupted<T: FieldAccess>(mut message: T, sampler: &mut Sampler<'_>) -> T {
    corrupt(&mut message, sampler);
    message
}

/// Checks a message; the error has its kind and the defect.
fn checked(kind: &str, message: &impl Check) -> Result<(), String> {
    message.check().map_err(|error| format!("{kind}: {error}"))
}

/// Receiving parts of all processes.
struct StackUnderTest<'a> {
    fixture: &'a StackFixture,
    names: &'a Names,
    snapshot: StackSnapshot,
    metrics: Metrics,
    viewer: Viewer,
    /// Last valid state.
    state: State,
    plan: Option<TickPlan>,
    /// Reference of the controller.
    reference: Reference,
    operator: Operator,
    /// Controller states in the last command.
    previous: PreviousStates,
    active: bool,
}

impl<'a> StackUnderTest<'a> {
    fn new(fixture: &'a StackFixture, snapshot: &StackSnapshot) -> Self {
        let messages = &snapshot.messages;
        Self {
            fixture,
            names: &fixture.names,
            metrics: Metrics::new(),
            viewer: Viewer::new(ViewerScene::default(), 60, 0),
            state: messages.state,
            plan: Some(TickPlan { tick: messages.reference.tick, state: messages.reference.planner }),
            reference: messages.reference,
            operator: messages.operator,
            previous: PreviousStates::of(&messages.command.request),
            active: true,
            snapshot: snapshot.clone(),
        }
    }

    fn receive(&mut self, sampler: &mut Sampler<'_>) -> Result<(), String> {
        let base = self.snapshot.messages;
        let next = self.state.tick.saturating_add(1);
        match sampler.byte() % 16 {
            0..=3 => self.state(&corrupted(State { tick: next, ..base.state }, sampler)),
            4 | 5 => self.reference(&corrupted(Reference { tick: next, ..base.reference }, sampler)),
            6 | 7 => {
                let tick = self.snapshot.gate.tick();
                let parameters_version = self.operator.at(tick).version;
                let request = Request { tick, state_tick: tick, parameters_version, ..base.command.request };
                self.request(&corrupted(request, sampler))
            }
            8 | 9 => {
                let tick = self.snapshot.plant.command_tick().saturating_add(1);
                self.command(&corrupted(Command { tick, ..base.command }, sampler))
            }
            10 | 11 => self.operator(&corrupted(base.operator, sampler)),
            12 => {
                let event = Event::new(
                    next,
                    Process::Planner,
                    EventKind::Lost,
                    Severity::Degraded,
                    Detector::Heartbeat,
                    "größer als ein Byte",
                );
                let event = corrupted(event, sampler);
                let _ = convert::event(&event);
                let _ = event.text();
                checked("event", &event)
            }
            13 => {
                let (process, phase) = (Process::Supervisor.code(), Phase::Running.code());
                let timing =
                    Timing { process, phase, tick: next, due_ns: 10, wake_ns: 20, latency_ns: 50_000, ..Timing::default() };
                let timing = corrupted(Timing { publish_ns: 60_000, ..timing }, sampler);
                self.metrics.push_timing(&convert::timing(&timing));
                checked("timing", &timing)
            }
            14 => {
                let request =
                    OperatorRequest::new(OperatorKind::Set, "stiffness.z=9000\0taper=0.1").map_err(|e| e.to_string())?;
                let request = corrupted(request, sampler);
                let (_, text) = request.parts().map_err(|error| format!("operator's request: {error}"))?;
                changed(text)
            }
            _ => {
                checked("credit", &corrupted(Credit { tick: next }, sampler))?;
                checked("operator's reply", &corrupted(OperatorReply::new(ReplyCode::Rejected, "größer"), sampler))
            }
        }
    }

    /// Passes a state to planner, controller, gate and recorder.
    fn state(&mut self, state: &State) -> Result<(), String> {
        let logged = convert::state(state, self.names);
        self.metrics.push_state(&logged);
        if self.viewer.due(state.tick) {
            let _ =
                self.viewer.scene_update(state.tick, &logged.contacts, Some(self.reference.position), Some(state.foot_position));
        }
        checked("state", state)?;
        if state.tick <= self.state.tick {
            return Err("state: found an old tick".to_owned());
        }
        self.state = *state;
        let parameters = *self.operator.at(state.tick);
        let plan = TickPlan::next(self.plan, state, self.active, &self.operator);
        self.plan = Some(plan);
        let inputs = ControlInputs {
            state,
            setpoint: ReferenceSetpoint::of(&self.reference),
            parameters: &parameters,
            previous: self.previous,
        };
        let request = control_step(&self.fixture.chain, &self.fixture.gravity, &inputs, Process::Controller);
        // The reference is for the next tick; the controller ignores an invalid one.
        let reference = plan.reference(parameters.version);
        if reference.check().is_ok() {
            self.reference = reference;
        }
        let Some(request) = request else {
            self.miss();
            return Err("state: the controller makes no request".to_owned());
        };
        for (force, most) in request.force.iter().zip(&parameters.max_force) {
            assert!(force.abs() <= *most, "found a force of {force} N, expected {most} N (F_max) at most");
        }
        self.request(&request)
    }

    fn reference(&mut self, reference: &Reference) -> Result<(), String> {
        self.metrics.push_reference(&convert::reference(reference));
        checked("reference", reference)?;
        self.reference = *reference;
        // A restarted planner continues from here.
        self.plan = Some(TickPlan::resumed(reference));
        Ok(())
    }

    /// Passes a request to the gate.
    fn request(&mut self, request: &Request) -> Result<(), String> {
        let _ = convert::request(request);
        let gate = &mut self.snapshot.gate;
        let parameters = self.operator.at(gate.tick());
        if let Err(error) = gate.validate(request, &self.state, parameters) {
            self.miss();
            return Err(format!("request: {error}"));
        }
        let command = gate.accept(ControllerSlot::First, request, &Observation::alone(), &GateInputs::default());
        self.publish(&command);
        Ok(())
    }

    fn miss(&mut self) {
        let command = self.snapshot.gate.miss(&Observation { overdue: true, ..Observation::default() }, &GateInputs::default());
        self.publish(&command);
    }

    /// Asserts that a command of the gate is valid, whatever the inputs were, and passes it on.
    fn publish(&mut self, command: &Command) {
        assert_eq!(command.check(), Ok(()), "the gate publishes an invalid command");
        let within = command.torque.iter().all(|torque| torque.abs() <= PEAK);
        assert!(within, "the gate publishes {:?} N m, its peak is {PEAK} N m", command.torque);
        let _ = self.command(command);
    }

    /// Passes a command to plant, planner and controllers.
    fn command(&mut self, command: &Command) -> Result<(), String> {
        self.metrics.push_command(&convert::command(command));
        checked("command", command)?;
        self.previous = PreviousStates::of(&command.request);
        self.active = command.mode == Mode::Active.code();
        let plant = &mut self.snapshot.plant;
        if plant.take(command) {
            let advanced = plant.advance();
            assert!(
                advanced.is_ok(),
                "the plant fails after an accepted command: {}",
                advanced.err().map(|e| e.to_string()).unwrap_or_default()
            );
            assert_eq!(plant.sample().check(), Ok(()), "the plant publishes an invalid state after an accepted command");
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

    /// Asserts that all metrics are finite, whatever the messages were.
    fn check_metrics(&self) {
        let figures = format!("{:?}", self.metrics.summary());
        let invalid = figures.split(|c: char| !c.is_ascii_alphanumeric()).find(|word| matches!(*word, "NaN" | "inf"));
        assert_eq!(invalid, None, "among the metrics {figures}");
    }
}
