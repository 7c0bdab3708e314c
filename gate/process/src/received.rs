//! Messages that the gate has received, and defects of those it has rejected.

use hapfic_gate::protocol::ControllerSlot;
use hapfic_messages::{Request, State, TickBuffer, ValidationError};

/// Controllers: the primary and its standby.
pub(super) const CONTROLLERS: usize = ControllerSlot::BOTH.len();

/// Recent messages.
#[derive(Debug)]
pub(super) struct Received {
    /// Requests of each controller, by slot.
    pub(super) requests: [TickBuffer<Request>; CONTROLLERS],
    /// States, which the requests answer.
    pub(super) states: TickBuffer<State>,
    /// Tick and publication time [ns] of the newest state.
    pub(super) newest: Option<(i64, u64)>,
    /// Tick of the command behind which this gate has begun; states up to it are of no use.
    pub(super) resumed: Option<i64>,
    /// Most slipped periods of any state, and the lateness of that state's timer [ns].
    pub(super) slip: (u64, u64),
}

impl Received {
    /// Begins behind the last command of another gate: the next state may come at any time.
    pub(super) fn resume(&mut self, last: i64) {
        self.resumed = Some(last);
        self.newest.get_or_insert((last, 1));
    }
}

impl Default for Received {
    fn default() -> Self {
        Self {
            requests: [TickBuffer::default(); CONTROLLERS],
            states: TickBuffer::default(),
            newest: None,
            resumed: None,
            slip: (0, 0),
        }
    }
}

/// Rejected messages: their number, and the defects to report in idle time.
#[derive(Debug, Default)]
pub(super) struct Rejections {
    pub(super) count: u32,
    pub(super) state: Option<ValidationError>,
    /// Defect of a request whose controller is unknown.
    pub(super) stray: Option<ValidationError>,
    pub(super) slots: [Option<ValidationError>; CONTROLLERS],
}
