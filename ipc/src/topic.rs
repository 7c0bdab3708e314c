//! The topics of the stack and their quality of service: one table, the same in every process.

use crate::message::{Command, Credit, Event, Operator, Reference, Request, State, Timing};
use core::marker::PhantomData;

/// Samples a control input keeps; the newest counts.
pub const CONTROL_DEPTH: usize = 4;
/// Samples a recorder's input keeps: how long it may be away, in ticks.
pub const RECORDER_DEPTH: usize = 512;

/// A topic: its name, its type, and how many may take part.
#[derive(Debug)]
pub struct Topic<T> {
    /// Name of the service.
    pub name: &'static str,
    /// Most publishers at a time. One more than needed, so that a successor can join before its dead forerunner is swept.
    pub publishers: usize,
    /// Samples kept for whoever joins late.
    pub history: usize,
    /// Whether sending wakes those who wait for it.
    pub wakes: bool,
    pub(crate) kind: PhantomData<fn() -> T>,
}

impl<T> Topic<T> {
    const fn new(name: &'static str, publishers: usize, history: usize, wakes: bool) -> Self {
        Self { name, publishers, history, wakes, kind: PhantomData }
    }
}

/// plant -> all.
pub const STATE: Topic<State> = Topic::new("state", 2, 1, true);
/// planner -> controllers.
pub const REFERENCE: Topic<Reference> = Topic::new("reference", 2, 1, true);
/// controllers -> gate.
pub const REQUEST: Topic<Request> = Topic::new("request", 4, 1, true);
/// gate -> plant, and the controllers' memory.
pub const COMMAND: Topic<Command> = Topic::new("command", 2, 1, true);
/// gate -> all: parameters in force and to come.
pub const OPERATOR: Topic<Operator> = Topic::new("operator", 2, 1, false);
/// all -> recorder.
pub const EVENT: Topic<Event> = Topic::new("event", 8, 0, false);
/// all -> recorder, watchdog.
pub const TIMING: Topic<Timing> = Topic::new("timing", 8, 0, false);
/// recorder -> plant, in lockstep.
pub const CREDIT: Topic<Credit> = Topic::new("credit", 2, 1, true);
