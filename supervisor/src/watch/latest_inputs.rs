//! Inputs of the main thread: the latest states, references and parameter sets, for operators and for the progress line.

use hapfic_ipc::{Bus, Input, IpcError, Wait, topic};
use hapfic_messages::{Check, Operator, Reference, State, TickBuffer};

/// Inputs, and what came last.
pub struct LatestInputs {
    state: Input<State>,
    states: TickBuffer<State>,
    reference: Input<Reference>,
    references: TickBuffer<Reference>,
    operator: Input<Operator>,
    sets: Option<Operator>,
}

impl LatestInputs {
    /// Subscribes to the topics.
    ///
    /// # Errors
    /// [`IpcError`] if the topics cannot be opened.
    pub fn open(bus: &Bus) -> Result<Self, IpcError> {
        Ok(Self {
            state: bus.input(&topic::STATE, Wait::No)?,
            states: TickBuffer::default(),
            reference: bus.input(&topic::REFERENCE, Wait::No)?,
            references: TickBuffer::default(),
            operator: bus.input(&topic::OPERATOR, Wait::No)?,
            sets: None,
        })
    }

    /// Receives new messages; leaves out those that fail their check.
    ///
    /// # Errors
    /// [`IpcError`] if a connection is damaged.
    pub fn receive(&mut self) -> Result<(), IpcError> {
        while let Some(state) = self.state.next()? {
            if state.check().is_ok() {
                self.states.insert(state);
            }
        }
        while let Some(reference) = self.reference.next()? {
            if reference.check().is_ok() {
                self.references.insert(reference);
            }
        }
        while let Some(sets) = self.operator.next()? {
            if sets.check().is_ok() {
                Operator::take_newer(&mut self.sets, sets);
            }
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
