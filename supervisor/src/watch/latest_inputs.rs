//! The latest states, references and parameter sets, for operators and for the progress line.
//!
//! The main thread reads them where their senders keep them for their successors: a subscriber more would cost these time at
//! every message. An external process keeps none, so its topic is subscribed to.

use crate::children::external_command;
use hapfic_config::Settings;
use hapfic_ipc::topic::{self, Topic};
use hapfic_ipc::{Bus, Input, IpcError, KeptMessages, Wait};
use hapfic_messages::{Check, Clock, Message, Operator, Process, Reference, State, TickBuffer};

/// Messages that a look takes: a reference belongs to the state of its tick.
const LAST: u32 = 4;

/// Where the messages of a sender are read.
enum Source<T: Message> {
    Kept(KeptMessages<T>),
    Topic(Input<T>),
}

impl<T: Check + Message> Source<T> {
    fn open(bus: &Bus, topic: &Topic<T>, sender: Process, settings: &Settings, clock: Clock) -> Result<Self, IpcError> {
        let kept = match external_command(&settings.processes, sender) {
            None => bus.kept_messages(topic, sender, clock)?,
            Some(_) => None,
        };
        Ok(match kept {
            Some(kept) => Self::Kept(kept),
            None => Self::Topic(bus.input(topic, Wait::No)?),
        })
    }

    /// Calls `take` with the last messages; leaves out those that fail their check.
    fn receive(&mut self, mut take: impl FnMut(T)) -> Result<(), IpcError> {
        let mut checked = |message: T| {
            if message.check().is_ok() {
                take(message);
            }
        };
        match self {
            Self::Kept(kept) => kept.last(LAST).into_iter().for_each(checked),
            Self::Topic(input) => {
                while let Some(message) = input.next()? {
                    checked(message);
                }
            }
        }
        Ok(())
    }
}

/// Inputs, and what came last.
pub struct LatestInputs {
    state: Source<State>,
    states: TickBuffer<State>,
    reference: Source<Reference>,
    references: TickBuffer<Reference>,
    /// Of both gates.
    operator: [Source<Operator>; 2],
    sets: Option<Operator>,
}

impl LatestInputs {
    /// Opens the inputs of a run.
    ///
    /// # Errors
    /// [`IpcError`] if they cannot be opened.
    pub fn open(bus: &Bus, settings: &Settings, clock: Clock) -> Result<Self, IpcError> {
        let sets = |gate| Source::open(bus, &topic::OPERATOR, gate, settings, clock);
        Ok(Self {
            state: Source::open(bus, &topic::STATE, Process::Plant, settings, clock)?,
            states: TickBuffer::default(),
            reference: Source::open(bus, &topic::REFERENCE, Process::Planner, settings, clock)?,
            references: TickBuffer::default(),
            operator: [sets(Process::Gate)?, sets(Process::SpareGate)?],
            sets: None,
        })
    }

    /// Reads new messages.
    ///
    /// # Errors
    /// [`IpcError`] if a connection is damaged.
    pub fn receive(&mut self) -> Result<(), IpcError> {
        let (states, references, sets) = (&mut self.states, &mut self.references, &mut self.sets);
        self.state.receive(|state| states.insert(state))?;
        self.reference.receive(|reference| references.insert(reference))?;
        for gate in &mut self.operator {
            gate.receive(|operator| Operator::take_newer(sets, operator))?;
        }
        Ok(())
    }

    /// Parameter sets published last; `None` before the first.
    pub fn operator(&self) -> Option<Operator> {
        self.sets
    }

    /// The newest state, with the reference of its tick if that is there.
    pub fn newest(&self) -> Option<(&State, Option<&Reference>)> {
        let state = self.states.newest()?;
        Some((state, self.references.at(state.tick)))
    }
}
