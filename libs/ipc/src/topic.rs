//! The topics of the stack and their quality of service: one table, the same in every process.

use crate::doorbell::DoorbellId;
use core::marker::PhantomData;
use hapfic_messages::{Command, Credit, Event, Injection, Operator, Reference, Request, State, Timing};

/// Ticks handed over to whoever joins late. One would do if nobody ever died: a planner that is started again works from the state
/// its forerunner saw last, which may be one or two behind the newest.
const HISTORY_DEPTH: usize = 4;
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
    /// The doorbell that sending rings, for those who wait.
    pub doorbell: Option<DoorbellId>,
    pub(crate) kind: PhantomData<fn() -> T>,
}

impl<T> Topic<T> {
    const fn new(name: &'static str, publishers: usize, history: usize, doorbell: Option<DoorbellId>) -> Self {
        Self { name, publishers, history, doorbell, kind: PhantomData }
    }
}

/// Rung with each [`STATE`].
pub const STATE_DOORBELL: DoorbellId = DoorbellId(0);
/// Rung with each [`REQUEST`].
pub const REQUEST_DOORBELL: DoorbellId = DoorbellId(2);
/// Rung with each [`COMMAND`].
pub const COMMAND_DOORBELL: DoorbellId = DoorbellId(3);

/// plant -> all. The supervisor hands the last ones on when the plant is started again.
pub const STATE: Topic<State> = Topic::new("state", 4, HISTORY_DEPTH, Some(STATE_DOORBELL));
/// planner -> controllers. The supervisor hands the last ones on when the planner is started again.
pub const REFERENCE: Topic<Reference> = Topic::new("reference", 4, HISTORY_DEPTH, Some(DoorbellId(1)));
/// controllers -> gate.
pub const REQUEST: Topic<Request> = Topic::new("request", 6, 1, Some(REQUEST_DOORBELL));
/// gate -> plant, and the controllers' memory.
pub const COMMAND: Topic<Command> = Topic::new("command", 2, HISTORY_DEPTH, Some(COMMAND_DOORBELL));
/// gate -> all: parameters in force and to come.
pub const OPERATOR: Topic<Operator> = Topic::new("operator", 2, 1, None);
/// all -> recorder.
pub const EVENT: Topic<Event> = Topic::new("event", 8, 0, None);
/// all -> recorder, watchdog.
pub const TIMING: Topic<Timing> = Topic::new("timing", 12, 0, None);
/// recorder -> plant, in lockstep.
pub const CREDIT: Topic<Credit> = Topic::new("credit", 2, 1, Some(DoorbellId(4)));
/// gate -> planner and controller in reserve, in realtime: a state has been answered, or should have been. A doorbell alone; nothing is
/// sent.
///
/// Each thread that a state woke would cost those who wait for its answer some microseconds, and tens of them if it sleeps on
/// another core. So a state wakes the primary only; the others, whom nobody waits for unless the primary fails, are woken when
/// there is time.
pub const COMMAND_SENT: DoorbellId = DoorbellId(5);
/// callers -> supervisor: an [operator's request](crate::service) waits.
pub const OPERATOR_REQUEST: DoorbellId = DoorbellId(6);
/// controller -> the gate's spare: no command follows the request. A doorbell alone.
pub const SPARE_GATE: DoorbellId = DoorbellId(7);
/// supervisor -> processes: faults to be made on purpose.
pub const INJECTION: Topic<Injection> = Topic::new("injection", 2, 0, None);
