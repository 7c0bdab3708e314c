//! Republication of the recorded messages for observers.

use super::RecordedMessage;
use hapfic_ipc::{Bus, IpcError, Output, topic::view};
use hapfic_messages::{Command, Event, Operator, Reference, Request, State, Timing};

/// Senders of the topics in [`view`].
pub(super) struct Views {
    state: Output<State>,
    reference: Output<Reference>,
    request: Output<Request>,
    command: Output<Command>,
    operator: Output<Operator>,
    event: Output<Event>,
    timing: Output<Timing>,
}

impl Views {
    /// Opens all senders.
    pub(super) fn open(bus: &Bus) -> Result<Self, IpcError> {
        Ok(Self {
            state: bus.output(&view::STATE)?,
            reference: bus.output(&view::REFERENCE)?,
            request: bus.output(&view::REQUEST)?,
            command: bus.output(&view::COMMAND)?,
            operator: bus.output(&view::OPERATOR)?,
            event: bus.output(&view::EVENT)?,
            timing: bus.output(&view::TIMING)?,
        })
    }

    /// Republishes a message. An observer that cannot be reached loses it; the run goes on.
    pub(super) fn publish(&mut self, message: &RecordedMessage) {
        let _ = match message {
            RecordedMessage::State(m) => self.state.send(m),
            RecordedMessage::Reference(m) => self.reference.send(m),
            RecordedMessage::Request(m) => self.request.send(m),
            RecordedMessage::Command(m) => self.command.send(m),
            RecordedMessage::Operator(m) => self.operator.send(m),
            RecordedMessage::Event(m) => self.event.send(m),
            RecordedMessage::Timing(m) => self.timing.send(m),
        };
    }
}
