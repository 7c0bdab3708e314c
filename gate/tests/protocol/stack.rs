//! The gate, both places of controllers and the operator, as a model: what there is, and what may happen next.

use crate::mutation::{self, Mutation};
use crate::rules::{Account, Broken, Gated, Rule};
use crate::seat::{Process, Seat};
use hapfic_gate::protocol::{Choice, ControllerSlot, GateInputs, Observation, Protocol, TickAction, WaitPolicy};
use hapfic_gate::restart::{RestartAction, RestartSignal, RestartStage};
use hapfic_messages::Severity;
use stateright::{Model, Property};

/// The model.
#[derive(Clone, Copy, Debug)]
pub struct Stack {
    pub policy: WaitPolicy,
    /// The places whose processes may fail.
    pub failing: [bool; 2],
    /// What is wrong with the code; `None`: as it runs.
    pub mutation: Option<Mutation>,
    /// The one property that is asked for; `None`: all.
    pub only: Option<&'static str>,
}

/// All there is at a moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct State {
    pub protocol: Protocol,
    pub seats: [Seat; 2],
    /// What the gate will find asked for at its next tick.
    pending: Pending,
    account: Account,
    /// What the last step broke.
    pub broken: Broken,
    news: News,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
struct Pending {
    stop: bool,
    rearm: bool,
}

/// What the last step brought that should be possible.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
struct News {
    /// Torque, after a brake.
    back: bool,
    /// A stop was left.
    left: bool,
    /// The primary changed.
    promoted: bool,
}

/// When a request comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrival {
    /// Before the gate's first look.
    Early,
    /// After it, and before the deadline.
    InTime,
    /// Too late.
    Late,
}

/// What the operator asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SchedRequest {
    Nothing,
    Stop,
    Rearm,
}

/// What may happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Move {
    /// A process is killed, or hangs.
    Silence(ControllerSlot),
    /// A process begins to send garbage.
    Garble(ControllerSlot),
    /// A process does its first tick.
    Join(ControllerSlot),
    /// The supervisor sees that it does.
    Notice(ControllerSlot),
    /// A detector speaks; what is left of the process is killed. It may be wrong about a process that is well.
    Lose(ControllerSlot),
    /// The supervisor looks whether a restart is due.
    Look(ControllerSlot),
    /// A millisecond passes for the restarts, however many ticks there are in it.
    Clock,
    /// The gate's tick.
    Tick { arrivals: [Arrival; 2], wish: SchedRequest },
}

pub const STOPPED: &str = "a stop is reached";
pub const LEFT: &str = "a stop is left";
pub const BACK: &str = "torque comes back after a brake";
pub const PROMOTED: &str = "the primary changes";
pub const SPENT: &str = "a budget is spent";

impl Model for Stack {
    type State = State;
    type Action = Move;

    fn init_states(&self) -> Vec<State> {
        vec![State {
            protocol: Protocol::default(),
            seats: [Seat::default(); 2],
            pending: Pending::default(),
            account: Account::default(),
            broken: Broken::default(),
            news: News::default(),
        }]
    }

    fn actions(&self, state: &State, actions: &mut Vec<Move>) {
        for place in ControllerSlot::BOTH {
            let seat = &state.seats[place as usize];
            if self.failing[place as usize] {
                if matches!(seat.process, Process::Joining | Process::Present | Process::Garbage) {
                    actions.push(Move::Silence(place));
                }
                if seat.process == Process::Present {
                    actions.push(Move::Garble(place));
                }
                if seat.process != Process::Absent {
                    actions.push(Move::Lose(place));
                }
            }
            if seat.process == Process::Joining {
                actions.push(Move::Join(place));
            }
            if seat.stage == RestartStage::Starting && matches!(seat.process, Process::Present | Process::Garbage) {
                actions.push(Move::Notice(place));
            }
            if matches!(seat.stage, RestartStage::BackOff(_) | RestartStage::GivenUp) {
                actions.push(Move::Look(place));
            }
        }
        actions.push(Move::Clock);
        for first in arrivals(&state.seats[0]) {
            for second in arrivals(&state.seats[1]) {
                for wish in [SchedRequest::Nothing, SchedRequest::Stop, SchedRequest::Rearm] {
                    actions.push(Move::Tick { arrivals: [*first, *second], wish });
                }
            }
        }
    }

    fn next_state(&self, state: &State, action: Move) -> Option<State> {
        let mut next = State { broken: Broken::default(), news: News::default(), ..*state };
        match action {
            Move::Silence(place) => next.seats[place as usize].process = Process::Silent,
            Move::Garble(place) => next.seats[place as usize].process = Process::Garbage,
            Move::Join(place) => next.seats[place as usize].process = Process::Present,
            Move::Notice(place) => self.take_note(&mut next, place, RestartSignal::Ticked),
            Move::Lose(place) => self.take_note(&mut next, place, RestartSignal::Lost),
            Move::Look(place) => self.take_note(&mut next, place, RestartSignal::Time),
            Move::Clock => next.seats.iter_mut().for_each(Seat::grow_older),
            Move::Tick { arrivals, wish } => self.tick(&mut next, arrivals, wish),
        }
        (next != *state).then_some(next)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        let mut properties = Rule::properties();
        properties.extend([
            Property::sometimes(STOPPED, |_: &Self, state: &State| state.protocol.severity == Severity::Stopped),
            Property::sometimes(LEFT, |_: &Self, state: &State| state.news.left),
            Property::sometimes(BACK, |_: &Self, state: &State| state.news.back),
            Property::sometimes(PROMOTED, |_: &Self, state: &State| state.news.promoted),
            Property::sometimes(SPENT, |_: &Self, state: &State| {
                state.seats.iter().any(|seat| seat.stage == RestartStage::GivenUp)
            }),
        ]);
        properties.retain(|property| self.only.is_none_or(|only| only == property.name));
        properties
    }
}

impl Stack {
    fn take_note(&self, next: &mut State, place: ControllerSlot, signal: RestartSignal) {
        let action = next.seats[place as usize].take_note(signal, self.mutation, &mut next.broken);
        next.pending.stop |= action == Some(RestartAction::Stop);
    }

    /// Two looks: one before the deadline, with what is early, and one at it. In lockstep, where nothing may come of either, the
    /// second is the one at which the gate has lost its policy with the controller that does not answer.
    fn tick(&self, next: &mut State, arrivals: [Arrival; 2], wish: SchedRequest) {
        match wish {
            SchedRequest::Nothing => {}
            SchedRequest::Stop => next.pending.stop = true,
            SchedRequest::Rearm => {
                next.pending.rearm = true;
                ControllerSlot::BOTH.iter().for_each(|place| self.take_note(next, *place, RestartSignal::Rearmed));
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

    fn gate(&self, next: &mut State, seen: &Observation, choice: Choice) {
        let missing = next.seats.iter().any(|seat| seat.stage != RestartStage::Working);
        let inputs = GateInputs {
            stop: next.pending.stop,
            rearm: next.pending.rearm,
            // In lockstep the clock waits for whoever is missing.
            missing: missing && self.policy == WaitPolicy::Deadline,
        };
        let before = next.protocol;
        let (mut after, action) = mutation::step(self.mutation, before, choice, seen, &inputs);
        // They are told anew at every tick; kept, they would only make more states of the same.
        (after.conditions.stop, after.conditions.rearm, after.conditions.missing) = (false, false, false);
        let tick = Gated { policy: self.policy, before, after, seen: *seen, inputs, choice, action };
        next.account = next.account.after(&tick, &mut next.broken);
        let spent = next.seats.iter().any(|seat| seat.spent);
        next.broken.expect(Rule::SpentStops, !spent || after.severity == Severity::Stopped);
        next.news = News {
            back: before.severity >= Severity::Brake && matches!(action, Some(TickAction::Pass(_))),
            left: before.severity == Severity::Stopped && after.severity < Severity::Stopped,
            promoted: before.primary != after.primary,
        };
        next.protocol = after;
        next.pending = Pending::default();
    }
}

/// When a place's request may come. Whoever answers may be late any number of times: more than a real one would.
fn arrivals(seat: &Seat) -> &'static [Arrival] {
    match seat.process {
        Process::Present | Process::Garbage => &[Arrival::Early, Arrival::InTime, Arrival::Late],
        Process::Absent | Process::Joining | Process::Silent => &[Arrival::Late],
    }
}

fn observe(state: &State, arrivals: [Arrival; 2], overdue: bool) -> Observation {
    let mut seen = Observation { overdue, ..Observation::default() };
    for place in ControllerSlot::BOTH {
        let i = place as usize;
        let come = match arrivals[i] {
            Arrival::Early => true,
            Arrival::InTime => overdue,
            Arrival::Late => false,
        };
        seen.valid[i] = come && state.seats[i].process == Process::Present;
        seen.rejected[i] = come && state.seats[i].process == Process::Garbage;
        // As far as the supervisor knows: a process may be silent already, or answer before it is expected to.
        seen.present[i] = state.seats[i].stage == RestartStage::Working;
    }
    seen
}
