//! Messages of a run, joined by tick for the watch of the conditions.

use super::{TaskReport, TaskWatch};
use hapfic_messages::{Command, Event, Operator, Parameters, Reference, State};
use std::collections::VecDeque;

/// Most ticks that wait for their other messages.
const WAITING: usize = 64;

/// Joins the messages of a run by their tick and passes them to the watch.
///
/// Messages may come topic by topic. A tick that lacks a message for long is left out.
#[derive(Clone, Debug)]
pub struct TaskFollower {
    watch: TaskWatch,
    sets: VecDeque<Parameters>,
    states: VecDeque<State>,
    references: VecDeque<Reference>,
    commands: VecDeque<Command>,
}

impl TaskFollower {
    /// Follows a run with a watch.
    #[must_use]
    pub fn new(watch: TaskWatch) -> Self {
        Self { watch, sets: VecDeque::new(), states: VecDeque::new(), references: VecDeque::new(), commands: VecDeque::new() }
    }

    /// Takes the operator's sets.
    pub fn operator(&mut self, operator: &Operator) {
        for set in [&operator.current, &operator.next] {
            if self.sets.back().is_none_or(|last| set.version > last.version) && set.version > 0 {
                self.sets.push_back(*set);
            }
        }
    }

    /// Takes a state.
    pub fn state(&mut self, state: &State) -> Vec<Event> {
        keep(&mut self.states, *state);
        self.advance()
    }

    /// Takes a reference.
    pub fn reference(&mut self, reference: &Reference) -> Vec<Event> {
        keep(&mut self.references, *reference);
        self.advance()
    }

    /// Takes a command.
    pub fn command(&mut self, command: &Command) -> Vec<Event> {
        keep(&mut self.commands, *command);
        self.advance()
    }

    /// Conditions that hold or have held.
    #[must_use]
    pub fn report(&self) -> Vec<TaskReport> {
        self.watch.report()
    }

    /// Passes all complete ticks on, in order.
    fn advance(&mut self) -> Vec<Event> {
        let mut events = Vec::new();
        while let (Some(state), Some(reference), Some(command)) =
            (self.states.front(), self.references.front(), self.commands.front())
        {
            let tick = state.tick.max(reference.tick).max(command.tick);
            if [state.tick, reference.tick, command.tick].iter().any(|t| *t < tick) {
                self.states.retain(|m| m.tick >= tick);
                self.references.retain(|m| m.tick >= tick);
                self.commands.retain(|m| m.tick >= tick);
                continue;
            }
            let in_force = self.sets.partition_point(|set| set.effective_tick <= tick);
            self.sets.drain(..in_force.saturating_sub(1));
            if let Some(set) = self.sets.front() {
                events.extend(self.watch.push(state, reference, command, set));
            }
            self.states.pop_front();
            self.references.pop_front();
            self.commands.pop_front();
        }
        events
    }
}

fn keep<T>(queue: &mut VecDeque<T>, message: T) {
    if queue.len() >= WAITING {
        queue.pop_front();
    }
    queue.push_back(message);
}
