//! The topics of the stack and their quality of service: one table, the same in every process.

use crate::message::{Command, Credit, Event, Injection, Operator, Reference, Request, State, Timing};
use core::marker::PhantomData;

/// Samples a control input keeps: more than a topic's history, so that what comes while it is handed over does not drive it out.
pub const CONTROL_DEPTH: usize = 8;
/// Ticks handed over to whoever joins late. One would do if nobody ever died: a planner that is started again works from the state
/// its forerunner saw last, which may be one or two behind the newest.
const HANDED_OVER: usize = 4;
/// Samples a recorder's input keeps: how long it may be away, in ticks.
pub const RECORDER_DEPTH: usize = 512;

/// A topic: its name, its type, and how many may take part.
#[derive(Debug)]
pub struct Topic<T> {
    /// Name of the service.
    pub name: &'static str,
    /// Most publishers at a time. More than needed, so that successors can join before their dead forerunners are swept.
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

/// plant -> all. The supervisor hands the last ones on when the plant is started again.
pub const STATE: Topic<State> = Topic::new("state", 4, HANDED_OVER, true);
/// planner -> controllers. The supervisor hands the last ones on when the planner is started again.
pub const REFERENCE: Topic<Reference> = Topic::new("reference", 4, HANDED_OVER, true);
/// controllers -> gate.
pub const REQUEST: Topic<Request> = Topic::new("request", 6, 1, true);
/// gate -> plant, and the controllers' memory.
pub const COMMAND: Topic<Command> = Topic::new("command", 2, HANDED_OVER, true);
/// gate -> all: parameters in force and to come.
pub const OPERATOR: Topic<Operator> = Topic::new("operator", 2, 1, false);
/// all -> recorder.
pub const EVENT: Topic<Event> = Topic::new("event", 8, 0, false);
/// all -> recorder, watchdog.
pub const TIMING: Topic<Timing> = Topic::new("timing", 12, 0, false);
/// recorder -> plant, in lockstep.
pub const CREDIT: Topic<Credit> = Topic::new("credit", 2, 1, true);
/// plant -> the controller in reserve: the state has been answered, or should have been. Only wakes; nothing is sent.
///
/// Waking a thread on another core costs the one who wakes tens of microseconds. So the plant wakes the primary when its state is
/// out, and the controller in reserve, which nobody waits for unless the primary fails, when there is time.
pub const ANSWERED: Topic<Credit> = Topic::new("answered", 2, 0, true);
/// supervisor -> processes: faults to be made on purpose.
pub const INJECTION: Topic<Injection> = Topic::new("injection", 2, 0, false);
