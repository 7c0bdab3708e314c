//! The gate, both places of controllers and the operator, as a model: what there is, and what may happen next.

use crate::mutation::{self, Mutation};
use crate::rules::{Account, Broken, Gated, Rule};
use crate::seat::{Process, Seat};
use hapfic_gate::protocol::{Action, Choice, Observed, Patience, Place, Protocol, Wishes};
use hapfic_gate::restart::{Order, Sign, Stage};
use hapfic_messages::Severity;
use stateright::{Model, Property};

/// The model.
#[derive(Clone, Copy, Debug)]
pub struct Stack {
    pub patience: Patience,
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
pub enum Wish {
    Nothing,
    Stop,
    Rearm,
}

/// What may happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Move {
    /// A process is killed, or hangs.
    Silence(Place),
    /// A process begins to send garbage.
    Garble(Place),
    /// A process does its first tick.
    Join(Place),
    /// The supervisor sees that it does.
    Notice(Place),
    /// A detector speaks; what is left of the process is killed. It may be wrong about a process that is well.
    Lose(Place),
    /// The supervisor looks whether a restart is due.
    Look(Place),
    /// A millisecond passes for the restarts, however many ticks there are in it.
    Clock,
    /// The gate's tick.
    Tick { arrivals: [Arrival; 2], wish: Wish },
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
        for place in Place::BOTH {
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
            if seat.stage == Stage::Starting && matches!(seat.process, Process::Present | Process::Garbage) {
                actions.push(Move::Notice(place));
            }
            if matches!(seat.stage, Stage::Due(_) | Stage::GivenUp) {
                actions.push(Move::Look(place));
            }
        }
        actions.push(Move::Clock);
        for first in arrivals(&state.seats[0]) {
            for second in arrivals(&state.seats[1]) {
                for wish in [Wish::Nothing, Wish::Stop, Wish::Rearm] {
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
            Move::Notice(place) => self.take_note(&mut next, place, Sign::Ticked),
            Move::Lose(place) => self.take_note(&mut next, place, Sign::Lost),
            Move::Look(place) => self.take_note(&mut next, place, Sign::Time),
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
            Property::sometimes(SPENT, |_: &Self, state: &State| state.seats.iter().any(|seat| seat.stage == Stage::GivenUp)),
        ]);
        properties.retain(|property| self.only.is_none_or(|only| only == property.name));
        properties
    }
}

impl Stack {
    fn take_note(&self, next: &mut State, place: Place, sign: Sign) {
        let order = next.seats[place as usize].take_note(sign, self.mutation, &mut next.broken);
        next.pending.stop |= order == Some(Order::Stop);
    }

    /// Two looks: one before the deadline, with what is early, and one at it. In lockstep, where nothing may come of either, the
    /// second is the one at which the gate has lost its patience with the controller that does not answer.
    fn tick(&self, next: &mut State, arrivals: [Arrival; 2], wish: Wish) {
        match wish {
            Wish::Nothing => {}
            Wish::Stop => next.pending.stop = true,
            Wish::Rearm => {
                next.pending.rearm = true;
                Place::BOTH.iter().for_each(|place| self.take_note(next, *place, Sign::Rearmed));
            }
        }
        for overdue in [false, true] {
            let seen = observe(next, arrivals, overdue);
            let choice = mutation::choose(self.mutation, &next.protocol, &seen, self.patience);
            if choice != Choice::Wait {
                self.gate(next, &seen, choice);
                return;
            }
        }
    }

    fn gate(&self, next: &mut State, seen: &Observed, choice: Choice) {
        let missing = next.seats.iter().any(|seat| seat.stage != Stage::Working);
        let wishes = Wishes {
            stop: next.pending.stop,
            rearm: next.pending.rearm,
            // In lockstep the clock waits for whoever is missing.
            missing: missing && self.patience == Patience::Deadline,
        };
        let before = next.protocol;
        let (mut after, action) = mutation::step(self.mutation, before, choice, seen, &wishes);
        // They are told anew at every tick; kept, they would only make more states of the same.
        (after.conditions.stop, after.conditions.rearm, after.conditions.missing) = (false, false, false);
        let tick = Gated { patience: self.patience, before, after, seen: *seen, wishes, choice, action };
        next.account = next.account.after(&tick, &mut next.broken);
        let spent = next.seats.iter().any(|seat| seat.spent);
        next.broken.expect(Rule::SpentStops, !spent || after.severity == Severity::Stopped);
        next.news = News {
            back: before.severity >= Severity::Brake && matches!(action, Some(Action::Pass(_))),
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

fn observe(state: &State, arrivals: [Arrival; 2], overdue: bool) -> Observed {
    let mut seen = Observed { overdue, ..Observed::default() };
    for place in Place::BOTH {
        let i = place as usize;
        let come = match arrivals[i] {
            Arrival::Early => true,
            Arrival::InTime => overdue,
            Arrival::Late => false,
        };
        seen.valid[i] = come && state.seats[i].process == Process::Present;
        seen.refused[i] = come && state.seats[i].process == Process::Garbage;
        // As far as the supervisor knows: a process may be silent already, or answer before it is expected to.
        seen.present[i] = state.seats[i].stage == Stage::Working;
    }
    seen
}
