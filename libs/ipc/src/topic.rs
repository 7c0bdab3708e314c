//! The topics of the stack and their quality of service: one table, the same in every process.

use crate::doorbell::DoorbellId;
use core::marker::PhantomData;
use hapfic_messages::{Command, Credit, Event, Injection, Message, Operator, Reference, Request, State, Timing};

/// Samples handed over to a late joiner.
///
/// Without restarts a single sample would do. A restarted planner works from the last state of its predecessor, which
/// may be one or two ticks behind the newest.
pub(crate) const HISTORY_DEPTH: usize = 4;
/// Samples that a recorder's input keeps: longest absence of the recorder [ticks].
pub const RECORDER_DEPTH: usize = 448;

/// Parameter sets that an input keeps: an operator makes at most one in five ticks, and the recorder drains every 10 ms.
const OPERATOR_DEPTH: usize = 64;

/// Messages of each sender that outlive it: the last ones for its successor, and in lockstep what is not flushed to the
/// log, which is at most [`MAX_UNFLUSHED`] ticks, with room for what successors send again.
const KEPT_FOR_SUCCESSOR: usize = 2 * HISTORY_DEPTH;
const KEPT_FOR_LOG: usize = MAX_UNFLUSHED + 256;
/// Ticks by which the plant may be ahead of the flushed log, in lockstep.
pub const MAX_UNFLUSHED: usize = 768;

/// Samples that an observer's input keeps: the recorder republishes every 10 ms.
pub const VIEW_DEPTH: usize = 64;

/// Events of each sender that outlive it, in lockstep: those of the ticks that are not flushed, as a rule a few.
const EVENTS_KEPT: usize = 256;

/// Recorders on a topic at a time: the successor of several that have been lost before the clean-up.
const RECORDERS: usize = 8;

/// A topic: its name, its type, and its capacities.
#[derive(Debug)]
pub struct Topic<T> {
    /// Name of the service.
    pub name: &'static str,
    /// Most publishers at a time. More than needed, so that successors can join before the clean-up of their
    /// predecessors.
    pub publishers: usize,
    /// Most subscribers at a time, as above; each costs memory in the segment of every publisher.
    pub subscribers: usize,
    /// Samples kept for late joiners.
    pub history: usize,
    /// Samples that an input of the topic keeps at most.
    pub depth: usize,
    /// Doorbell that sending notifies, if any thread waits for the topic.
    pub doorbell: Option<DoorbellId>,
    /// Messages of each sender that outlive it, by the clock of the run; 0: none.
    pub(crate) kept_realtime: usize,
    pub(crate) kept_lockstep: usize,
    pub(crate) kind: PhantomData<fn() -> T>,
}

impl<T> Topic<T> {
    const fn new(name: &'static str, publishers: usize, history: usize, doorbell: Option<DoorbellId>) -> Self {
        let kind = PhantomData;
        Self {
            name,
            publishers,
            subscribers: 14,
            history,
            depth: RECORDER_DEPTH,
            doorbell,
            kept_realtime: 0,
            kept_lockstep: 0,
            kind,
        }
    }

    const fn keeping(self, kept_realtime: usize, kept_lockstep: usize) -> Self {
        Self { kept_realtime, kept_lockstep, ..self }
    }

    const fn with_subscribers(self, subscribers: usize) -> Self {
        Self { subscribers, ..self }
    }

    /// Whether it is for observers.
    pub(crate) fn is_view(&self) -> bool {
        self.name.starts_with("view/")
    }

    const fn view(name: &'static str, history: usize) -> Self {
        Self { subscribers: 12, depth: VIEW_DEPTH, ..Self::new(name, RECORDERS, history, None) }
    }
}

/// Notified with each [`STATE`].
pub const STATE_DOORBELL: DoorbellId = DoorbellId(0);
/// Notified with each [`REQUEST`].
pub const REQUEST_DOORBELL: DoorbellId = DoorbellId(2);
/// Notified with each [`COMMAND`].
pub const COMMAND_DOORBELL: DoorbellId = DoorbellId(3);

/// plant -> all. A successor of the plant publishes the last ones again.
pub const STATE: Topic<State> =
    Topic::new("state", 7, HISTORY_DEPTH, Some(STATE_DOORBELL)).with_subscribers(16).keeping(KEPT_FOR_SUCCESSOR, KEPT_FOR_LOG);
/// planner -> controllers. A successor of the planner publishes the last ones again.
pub const REFERENCE: Topic<Reference> =
    Topic::new("reference", 7, HISTORY_DEPTH, Some(DoorbellId(1))).with_subscribers(10).keeping(KEPT_FOR_SUCCESSOR, KEPT_FOR_LOG);
/// controllers -> gate.
pub const REQUEST: Topic<Request> =
    Topic::new("request", 6, 1, Some(REQUEST_DOORBELL)).with_subscribers(10).keeping(0, KEPT_FOR_LOG);
/// gates -> plant, and controllers, as their memory. A gate that takes over publishes the last one again.
pub const COMMAND: Topic<Command> =
    Topic::new("command", 7, HISTORY_DEPTH, Some(COMMAND_DOORBELL)).with_subscribers(13).keeping(0, KEPT_FOR_LOG);
/// gate -> all: parameters in force and to come.
pub const OPERATOR: Topic<Operator> = Topic {
    depth: OPERATOR_DEPTH,
    ..Topic::new("operator", 7, 1, None).with_subscribers(12).keeping(KEPT_FOR_SUCCESSOR, OPERATOR_DEPTH)
};
/// all -> recorder.
pub const EVENT: Topic<Event> = Topic::new("event", 12, 0, None).with_subscribers(6).keeping(0, EVENTS_KEPT);
/// all -> recorder, watchdog.
pub const TIMING: Topic<Timing> = Topic::new("timing", 14, 0, None).with_subscribers(6).keeping(0, KEPT_FOR_LOG);
/// recorder -> plant, in lockstep; the supervisor, once a run goes on without its recorder.
pub const CREDIT: Topic<Credit> = Topic::new("credit", RECORDERS + 1, 1, Some(DoorbellId(4))).with_subscribers(6);
/// gate -> planner and standby controller, in realtime: a state is answered, or its answer is late. A doorbell without
/// a message.
///
/// Each thread that a state woke would delay the answer by some microseconds, and by tens of them if it sleeps on
/// another core. So a state wakes the primary only. The others are not needed unless the primary fails, and wake in
/// idle time.
pub const COMMAND_SENT: DoorbellId = DoorbellId(5);
/// callers -> supervisor: an [operator request](crate::service) waits.
pub const OPERATOR_REQUEST: DoorbellId = DoorbellId(6);
/// controller and supervisor -> the gate that is not the active one: no command follows the request, or the active gate is
/// lost. A doorbell without a message.
pub const SPARE_GATE: DoorbellId = DoorbellId(7);
/// supervisor -> processes: faults to inject.
pub const INJECTION: Topic<Injection> = Topic::new("injection", 4, 0, None);

/// A topic as data, for programs in other languages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TopicLayout {
    /// Name of the service.
    pub name: &'static str,
    /// Name of the message's type.
    pub message: &'static str,
    /// Number of the doorbell that sending notifies.
    pub doorbell: Option<usize>,
    /// Samples kept for late joiners.
    pub history: usize,
    /// Messages of each sender that outlive it, in realtime and in lockstep; 0: there is no ring.
    pub kept: [usize; 2],
}

impl<T: Message> Topic<T> {
    const fn layout(&self) -> TopicLayout {
        let doorbell = match self.doorbell {
            Some(id) => Some(id.0),
            None => None,
        };
        let kept = [self.kept_realtime, self.kept_lockstep];
        TopicLayout { name: self.name, message: T::NAME, doorbell, history: self.history, kept }
    }
}

/// All topics.
pub const TOPICS: &[TopicLayout] = &[
    STATE.layout(),
    REFERENCE.layout(),
    REQUEST.layout(),
    COMMAND.layout(),
    OPERATOR.layout(),
    EVENT.layout(),
    TIMING.layout(),
    CREDIT.layout(),
    INJECTION.layout(),
    view::STATE.layout(),
    view::REFERENCE.layout(),
    view::REQUEST.layout(),
    view::COMMAND.layout(),
    view::OPERATOR.layout(),
    view::EVENT.layout(),
    view::TIMING.layout(),
];

/// Doorbells without a topic of their own, by name.
pub const DOORBELLS: &[(&str, usize)] =
    &[("COMMAND_SENT", COMMAND_SENT.0), ("OPERATOR_REQUEST", OPERATOR_REQUEST.0), ("SPARE_GATE", SPARE_GATE.0)];

/// Topics for observers, which the recorder republishes from what it has received.
///
/// A subscriber that joins or leaves a control topic makes its senders allocate memory at their next message. So whatever
/// looks at a run from outside joins these, and the control topics never notice it.
pub mod view {
    use super::{Command, Event, Operator, Reference, Request, State, Timing, Topic};

    /// Measurements of the plant.
    pub const STATE: Topic<State> = Topic::view("view/state", 1);
    /// References of the planner.
    pub const REFERENCE: Topic<Reference> = Topic::view("view/reference", 1);
    /// Requests of both controllers.
    pub const REQUEST: Topic<Request> = Topic::view("view/request", 1);
    /// Commands of the gate.
    pub const COMMAND: Topic<Command> = Topic::view("view/command", 1);
    /// Parameters in force and to come.
    pub const OPERATOR: Topic<Operator> = Topic::view("view/operator", 1);
    /// Events.
    pub const EVENT: Topic<Event> = Topic::view("view/event", 16);
    /// Timing of all processes.
    pub const TIMING: Topic<Timing> = Topic::view("view/timing", 0);
}
