//! The pair of gates: every order of steps, deaths and restarts, and for each rule a mutation that breaks it.
//!
//! A command stands for its author and for the command before it, so two gates that decide the same tick make different
//! commands: more than real gates do, which compute the same from the same requests.

use hapfic_gate::pair::{CatchUp, OwnerView};
use stateright::{Checker, Model, Property};

/// Ticks of the model.
const TICKS: usize = 3;
/// Deaths in all.
const DEATHS: u8 = 3;

/// Rule that a mutation breaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Broken {
    Nothing,
    /// The next owner decides without a look at the page.
    Page,
    /// The next owner follows and never publishes again.
    Again,
    /// The owner publishes before it writes the page.
    Order,
    /// A gate that does not get the lock goes on all the same.
    Lock,
    /// A command is noted as published before it is, and the lock says nothing of a death.
    Note,
}

/// Step of an owner that comes next.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Phase {
    Idle,
    /// It has the lock; whether its owner before has died with it.
    Look {
        inherited: bool,
    },
    Write(u8),
    /// To the plant, then to the others.
    SendPlant(u8, bool),
    SendOthers(u8, bool),
    Note(u8, bool),
    Unlock,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Gate {
    alive: bool,
    /// Ticks done or followed, and the last command.
    done: usize,
    last: u8,
    phase: Phase,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Lock {
    Free,
    Held,
    OwnerDied,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Pair {
    gates: [Gate; 2],
    lock: Lock,
    owner: usize,
    /// Ticks and last command in the page.
    written: (usize, u8),
    published: usize,
    /// First command of each tick that has reached the plant, and the others; 0: none.
    plant: [u8; TICKS],
    others: [u8; TICKS],
    /// Whether a tick has had a second command.
    second: bool,
    deaths: u8,
}

impl Pair {
    /// Notes that a command of a tick was sent; returns the first one.
    fn sent(&mut self, tick: usize, command: u8) -> u8 {
        let first = [self.plant[tick], self.others[tick]].into_iter().find(|first| *first != 0).unwrap_or(command);
        self.second |= first != command;
        first
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Action {
    Step(usize),
    Die(usize),
    Restart(usize),
}

struct PairModel(Broken);

/// First command of a gate behind another one: both are in it.
fn command(author: usize, before: u8) -> u8 {
    before * 3 + 1 + author as u8
}

impl PairModel {
    fn step(&self, pair: &mut Pair, i: usize) -> bool {
        let broken = self.0;
        let Gate { done, last, phase, .. } = pair.gates[i];
        let next = match phase {
            Phase::Idle => {
                if done >= TICKS && pair.published >= TICKS {
                    return false;
                }
                let inherited = pair.lock == Lock::OwnerDied && broken != Broken::Note;
                if pair.lock == Lock::Held && broken != Broken::Lock {
                    return false;
                }
                (pair.lock, pair.owner) = (Lock::Held, i);
                Phase::Look { inherited }
            }
            Phase::Look { inherited } => {
                let tick = |count: usize| count as i64 - 1;
                let view =
                    OwnerView { own: tick(done), written: tick(pair.written.0), published: tick(pair.published), inherited };
                let CatchUp { follow, publish } = view.catch_up();
                if follow && broken != Broken::Page {
                    (pair.gates[i].done, pair.gates[i].last) = pair.written;
                    match publish && broken != Broken::Again {
                        true => Phase::SendPlant(pair.written.1, true),
                        false => Phase::Look { inherited: false },
                    }
                } else if done >= TICKS {
                    Phase::Unlock
                } else {
                    let command = command(i, last);
                    match broken {
                        Broken::Order => Phase::SendPlant(command, false),
                        _ => Phase::Write(command),
                    }
                }
            }
            Phase::Write(command) => {
                pair.written = (done + 1, command);
                if broken == Broken::Note {
                    pair.published = done + 1;
                }
                match broken {
                    Broken::Order => Phase::Note(command, false),
                    _ => Phase::SendPlant(command, false),
                }
            }
            Phase::SendPlant(command, again) => {
                let tick = if again { done - 1 } else { done };
                pair.plant[tick] = pair.sent(tick, command);
                Phase::SendOthers(command, again)
            }
            Phase::SendOthers(command, again) => {
                let tick = if again { done - 1 } else { done };
                pair.others[tick] = pair.sent(tick, command);
                match broken {
                    Broken::Order if !again => Phase::Write(command),
                    _ => Phase::Note(command, again),
                }
            }
            Phase::Note(command, again) => {
                if !again {
                    (pair.gates[i].done, pair.gates[i].last) = (done + 1, command);
                }
                pair.published = pair.published.max(pair.gates[i].done);
                if again { Phase::Look { inherited: false } } else { Phase::Unlock }
            }
            Phase::Unlock => {
                if pair.owner == i {
                    pair.lock = Lock::Free;
                }
                Phase::Idle
            }
        };
        pair.gates[i].phase = next;
        true
    }
}

impl Model for PairModel {
    type State = Pair;
    type Action = Action;

    fn init_states(&self) -> Vec<Pair> {
        let gate = Gate { alive: true, done: 0, last: 0, phase: Phase::Idle };
        vec![Pair {
            gates: [gate; 2],
            lock: Lock::Free,
            owner: 0,
            written: (0, 0),
            published: 0,
            plant: [0; TICKS],
            others: [0; TICKS],
            second: false,
            deaths: 0,
        }]
    }

    fn actions(&self, pair: &Pair, actions: &mut Vec<Action>) {
        for i in 0..2 {
            if pair.gates[i].alive {
                actions.push(Action::Step(i));
                if pair.deaths < DEATHS {
                    actions.push(Action::Die(i));
                }
            } else {
                actions.push(Action::Restart(i));
            }
        }
    }

    fn next_state(&self, pair: &Pair, action: Action) -> Option<Pair> {
        let mut next = *pair;
        match action {
            Action::Step(i) => return self.step(&mut next, i).then_some(next),
            Action::Die(i) => {
                next.deaths += 1;
                next.gates[i].alive = false;
                if next.lock == Lock::Held && next.owner == i && next.gates[i].phase != Phase::Idle {
                    next.lock = Lock::OwnerDied;
                }
            }
            // A new process: it knows nothing.
            Action::Restart(i) => next.gates[i] = Gate { alive: true, done: 0, last: 0, phase: Phase::Idle },
        }
        Some(next)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        let one = |_: &Self, pair: &Pair| !pair.second;
        let in_order = |_: &Self, pair: &Pair| {
            (1..TICKS).all(|tick| pair.plant[tick] == 0 || pair.plant[tick - 1] != 0)
                && (0..pair.published.saturating_sub(1)).all(|tick| pair.others[tick] != 0)
        };
        let all_done = |_: &Self, pair: &Pair| pair.published == TICKS && pair.deaths == DEATHS;
        vec![
            Property::always("one command of a tick", one),
            Property::always("no tick is left out", in_order),
            Property::sometimes("every tick is done, with all deaths", all_done),
        ]
    }
}

fn explored(broken: Broken) -> impl Checker<PairModel> {
    PairModel(broken).checker().threads(2).spawn_bfs().join()
}

#[test]
fn pair_all_orders_keep_rules() {
    let checker = explored(Broken::Nothing);
    println!("pair of gates: {} states, {} steps", checker.unique_state_count(), checker.state_count());
    checker.assert_properties();
    assert!(checker.unique_state_count() > 10_000);
}

fn expect_found(broken: Broken, rule: &'static str) {
    let checker = explored(broken);
    assert!(checker.discovery(rule).is_some(), "{broken:?}: the checker finds nothing against '{rule}'");
}

#[test]
fn mutant_owner_without_look_at_page_is_found() {
    expect_found(Broken::Page, "one command of a tick");
}

#[test]
fn mutant_command_not_published_again_is_found() {
    expect_found(Broken::Again, "no tick is left out");
}

#[test]
fn mutant_publication_before_page_is_found() {
    expect_found(Broken::Order, "one command of a tick");
}

#[test]
fn mutant_gate_without_lock_is_found() {
    expect_found(Broken::Lock, "one command of a tick");
}

#[test]
fn mutant_noted_before_publication_is_found() {
    expect_found(Broken::Note, "no tick is left out");
}
