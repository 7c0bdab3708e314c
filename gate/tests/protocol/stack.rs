//! Model of the gate, both controller slots and the operator: its state, and its next moves.

use crate::mutation::{self, Mutation};
use crate::rules::{BrokenRules, GatedTick, Rule, TickCounts};
use crate::slot::{ProcessModel, SlotModel};
use hapfic_gate::protocol::{Choice, ControllerSlot, GateInputs, Observation, Protocol, TickAction, WaitPolicy};
use hapfic_gate::restart_policy::{RestartAction, RestartSignal, RestartStage};
use hapfic_messages::Severity;
use stateright::{Model, Property};

/// Model of the stack.
#[derive(Clone, Copy, Debug)]
pub struct StackModel {
    pub policy: WaitPolicy,
    /// Slots whose processes may fail.
    pub failing: [bool; 2],
    /// Defect of the code; `None`: the code as it runs.
    pub mutation: Option<Mutation>,
    /// The only property to check; `None`: all.
    pub only: Option<&'static str>,
}

/// State of the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct StackState {
    pub protocol: Protocol,
    pub slots: [SlotModel; 2],
    /// Inputs of the gate's next tick.
    pending: PendingInputs,
    counts: TickCounts,
    /// Rules that the last step broke.
    pub broken: BrokenRules,
    milestones: Milestones,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
struct PendingInputs {
    stop: bool,
    rearm: bool,
}

/// Events of the last step that should be possible.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
struct Milestones {
    /// Torque after a brake.
    back: bool,
    /// End of a stop.
    left: bool,
    /// Change of the primary.
    promoted: bool,
}

/// Arrival of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrival {
    /// Before the gate's first check.
    Early,
    /// After the first check, and before the deadline.
    InTime,
    /// After the deadline.
    Late,
}

/// Input of the operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OperatorInput {
    Nothing,
    Stop,
    Rearm,
}

/// Move of the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelAction {
    /// A process is killed, or hangs.
    Silence(ControllerSlot),
    /// A process begins to send invalid requests.
    Corrupt(ControllerSlot),
    /// A process does its first tick.
    Join(ControllerSlot),
    /// The supervisor sees the first tick of a process.
    ObserveTick(ControllerSlot),
    /// A detector reports a process, which is killed. It may be wrong about a healthy process.
    Detect(ControllerSlot),
    /// The supervisor checks whether a restart is due.
    CheckRestart(ControllerSlot),
    /// A millisecond passes for the restarts, with any number of ticks in it.
    Clock,
    /// The gate's tick.
    Tick { arrivals: [Arrival; 2], input: OperatorInput },
}

pub const STOPPED: &str = "a stop is reached";
pub const LEFT: &str = "a stop is left";
pub const BACK: &str = "torque comes back after a brake";
pub const PROMOTED: &str = "the primary changes";
pub const SPENT: &str = "a budget is spent";

impl Model for StackModel {
    type State = StackState;
    type Action = ModelAction;

    fn init_states(&self) -> Vec<StackState> {
        vec![StackState {
            protocol: Protocol::default(),
            slots: [SlotModel::default(); 2],
            pending: PendingInputs::default(),
            counts: TickCounts::default(),
            broken: BrokenRules::default(),
            milestones: Milestones::default(),
        }]
    }

    fn actions(&self, state: &StackState, actions: &mut Vec<ModelAction>) {
        for slot in ControllerSlot::BOTH {
            let model = &state.slots[slot as usize];
            if self.failing[slot as usize] {
                if matches!(model.process, ProcessModel::Joining | ProcessModel::Present | ProcessModel::Garbage) {
                    actions.push(ModelAction::Silence(slot));
                }
                if model.process == ProcessModel::Present {
                    actions.push(ModelAction::Corrupt(slot));
                }
                if model.process != ProcessModel::Missing {
                    actions.push(ModelAction::Detect(slot));
                }
            }
            if model.process == ProcessModel::Joining {
                actions.push(ModelAction::Join(slot));
            }
            if model.stage == RestartStage::Starting && matches!(model.process, ProcessModel::Present | ProcessModel::Garbage) {
                actions.push(ModelAction::ObserveTick(slot));
            }
            if matches!(model.stage, RestartStage::BackOff(_) | RestartStage::BudgetSpent) {
                actions.push(ModelAction::CheckRestart(slot));
            }
        }
        actions.push(ModelAction::Clock);
        for first in arrivals(&state.slots[0]) {
            for second in arrivals(&state.slots[1]) {
                for input in [OperatorInput::Nothing, OperatorInput::Stop, OperatorInput::Rearm] {
                    actions.push(ModelAction::Tick { arrivals: [*first, *second], input });
                }
            }
        }
    }

    fn next_state(&self, state: &StackState, action: ModelAction) -> Option<StackState> {
        let mut next = StackState { broken: BrokenRules::default(), milestones: Milestones::default(), ..*state };
        match action {
            ModelAction::Silence(slot) => next.slots[slot as usize].process = ProcessModel::Silent,
            ModelAction::Corrupt(slot) => next.slots[slot as usize].process = ProcessModel::Garbage,
            ModelAction::Join(slot) => next.slots[slot as usize].process = ProcessModel::Present,
            ModelAction::ObserveTick(slot) => self.on_signal(&mut next, slot, RestartSignal::Ticked),
            ModelAction::Detect(slot) => self.on_signal(&mut next, slot, RestartSignal::Lost),
            ModelAction::CheckRestart(slot) => self.on_signal(&mut next, slot, RestartSignal::Time),
            ModelAction::Clock => next.slots.iter_mut().for_each(SlotModel::advance_ms),
            ModelAction::Tick { arrivals, input } => self.tick(&mut next, arrivals, input),
        }
        (next != *state).then_some(next)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        let mut properties = Rule::properties();
        properties.extend([
            Property::sometimes(STOPPED, |_: &Self, state: &StackState| state.protocol.severity == Severity::Stopped),
            Property::sometimes(LEFT, |_: &Self, state: &StackState| state.milestones.left),
            Property::sometimes(BACK, |_: &Self, state: &StackState| state.milestones.back),
            Property::sometimes(PROMOTED, |_: &Self, state: &StackState| state.milestones.promoted),
            Property::sometimes(SPENT, |_: &Self, state: &StackState| {
                state.slots.iter().any(|model| model.stage == RestartStage::BudgetSpent)
            }),
        ]);
        properties.retain(|property| self.only.is_none_or(|only| only == property.name));
        properties
    }
}

impl StackModel {
    fn on_signal(&self, next: &mut StackState, slot: ControllerSlot, signal: RestartSignal) {
        let action = next.slots[slot as usize].on_signal(signal, self.mutation, &mut next.broken);
        next.pending.stop |= action == Some(RestartAction::Stop);
    }

    /// Two checks of the gate: before the deadline, with the early requests, and at the deadline. In lockstep, where
    /// neither may lead to a tick, the second is the check after the time-out of the missing answer.
    fn tick(&self, next: &mut StackState, arrivals: [Arrival; 2], input: OperatorInput) {
        match input {
            OperatorInput::Nothing => {}
            OperatorInput::Stop => next.pending.stop = true,
            OperatorInput::Rearm => {
                next.pending.rearm = true;
                ControllerSlot::BOTH.iter().for_each(|slot| self.on_signal(next, *slot, RestartSignal::Rearmed));
            }
        }
        for overdue in [false, true] {
            let seen = observe(next, arrivals, overdue);
            let choice = mutation::choose(self.mutation, &next.protocol, &seen, self.policy);
            if choice != Choice::Wait {
                self.gate(next, &seen, choice);
                return;
            }
        }
    }

    fn gate(&self, next: &mut StackState, seen: &Observation, choice: Choice) {
        let missing = next.slots.iter().any(|model| model.stage != RestartStage::Working);
        let inputs = GateInputs {
            stop: next.pending.stop,
            rearm: next.pending.rearm,
            // In lockstep the clock waits for a missing process.
            missing: missing && self.policy == WaitPolicy::Deadline,
        };
        let before = next.protocol;
        let (mut after, action) = mutation::step(self.mutation, before, choice, seen, &inputs);
        // Inputs are new at every tick; kept, they would only multiply equal states.
        (after.conditions.stop, after.conditions.rearm, after.conditions.missing) = (false, false, false);
        let tick = GatedTick { policy: self.policy, before, after, seen: *seen, inputs, choice, action };
        next.counts = next.counts.after(&tick, &mut next.broken);
        let spent = next.slots.iter().any(|model| model.spent);
        next.broken.expect(Rule::SpentStops, !spent || after.severity == Severity::Stopped);
        next.milestones = Milestones {
            back: before.severity >= Severity::Brake && matches!(action, Some(TickAction::Pass(_))),
            left: before.severity == Severity::Stopped && after.severity < Severity::Stopped,
            promoted: before.primary != after.primary,
        };
        next.protocol = after;
        next.pending = PendingInputs::default();
    }
}

/// Possible arrivals of a slot's request. An answering process may be late without bound, unlike a real process.
fn arrivals(model: &SlotModel) -> &'static [Arrival] {
    match model.process {
        ProcessModel::Present | ProcessModel::Garbage => &[Arrival::Early, Arrival::InTime, Arrival::Late],
        ProcessModel::Missing | ProcessModel::Joining | ProcessModel::Silent => &[Arrival::Late],
    }
}

fn observe(state: &StackState, arrivals: [Arrival; 2], overdue: bool) -> Observation {
    let mut seen = Observation { overdue, ..Observation::default() };
    for slot in ControllerSlot::BOTH {
        let i = slot as usize;
        let come = match arrivals[i] {
            Arrival::Early => true,
            Arrival::InTime => overdue,
            Arrival::Late => false,
        };
        seen.valid[i] = come && state.slots[i].process == ProcessModel::Present;
        seen.rejected[i] = come && state.slots[i].process == ProcessModel::Garbage;
        // As the supervisor sees it: the process may already be silent, or answer before its first tick is seen.
        seen.present[i] = state.slots[i].stage == RestartStage::Working;
    }
    seen
}
