//! Methods of the writer for each topic.

use crate::error::LogError;
use crate::topic::Topic;
use crate::writer::Writer;
use crate::{convert, proto};
use foxglove::messages::{FrameTransforms, Log, SceneUpdate};
use hapfic_messages::{Command, Event, Parameters, Process, Reference, Request, State, Timing};
use std::io::Write;

impl<W: Write> Writer<W> {
    /// Writes to `/state`; returns the written message.
    ///
    /// # Errors
    /// [`LogError::Write`], as for every method that writes.
    pub fn state(&mut self, state: &State) -> Result<proto::State, LogError> {
        let message = convert::state(state, self.names());
        self.put(Topic::State, message.tick, self.time_of(message.tick), &message)?;
        Ok(message)
    }

    /// Writes to `/reference`; returns the written message.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn reference(&mut self, reference: &Reference) -> Result<proto::Reference, LogError> {
        let message = convert::reference(reference);
        self.put(Topic::Reference, message.tick, self.time_of(message.tick), &message)?;
        Ok(message)
    }

    /// Writes to `/request/standby` for a request of the standby, else to `/request`; returns the written message.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn request(&mut self, request: &Request) -> Result<proto::Request, LogError> {
        let message = convert::request(request);
        let topic = if request.controller == Process::Standby.code() { Topic::StandbyRequest } else { Topic::Request };
        self.put(topic, message.tick, self.time_of(message.tick), &message)?;
        Ok(message)
    }

    /// Writes to `/command`; returns the written message.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn command(&mut self, command: &Command) -> Result<proto::Command, LogError> {
        let message = convert::command(command);
        self.put(Topic::Command, message.tick, self.time_of(message.tick), &message)?;
        Ok(message)
    }

    /// Writes to `/operator`, at the tick from which the set is in force; returns the written message.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn operator(&mut self, parameters: &Parameters) -> Result<proto::Operator, LogError> {
        let message = convert::operator(parameters);
        let tick = message.effective_tick;
        self.put(Topic::Operator, tick, self.time_of(tick), &message)?;
        Ok(message)
    }

    /// Writes to `/event`; returns the written message.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn event(&mut self, event: &Event) -> Result<proto::Event, LogError> {
        let message = convert::event(event);
        self.put(Topic::Event, message.tick, self.time_of(message.tick), &message)?;
        Ok(message)
    }

    /// Writes to `/timing` with its own time [ns]: a waiting process has no tick. Returns the written message.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn timing(&mut self, timing: &Timing, log_time_ns: u64) -> Result<proto::Timing, LogError> {
        let message = convert::timing(timing);
        self.put(Topic::Timing, message.tick, log_time_ns, &message)?;
        Ok(message)
    }

    /// Writes to `/tf`.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn transforms(&mut self, tick: i64, transforms: &FrameTransforms) -> Result<(), LogError> {
        self.put(Topic::Transforms, tick, self.time_of(tick), transforms)
    }

    /// Writes to `/scene`.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn scene(&mut self, tick: i64, scene: &SceneUpdate) -> Result<(), LogError> {
        self.put(Topic::Scene, tick, self.time_of(tick), scene)
    }

    /// Writes to `/log`.
    ///
    /// # Errors
    /// [`LogError::Write`].
    pub fn log(&mut self, tick: i64, line: &Log) -> Result<(), LogError> {
        self.put(Topic::Log, tick, self.time_of(tick), line)
    }
}
