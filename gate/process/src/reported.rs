//! Conditions that the gate's events have reported.

use hapfic_gate::protocol::ControllerSlot;
use hapfic_messages::Command;

/// Conditions of the last tick that events report when they change.
#[derive(Debug)]
pub(super) struct Reported {
    /// Slot that the last tick promoted to primary.
    pub(super) promoted: Option<ControllerSlot>,
    /// Ticks in a row without a request.
    pub(super) missed: u64,
    /// Last tick at which the controllers' requests were compared, and whether they differed.
    pub(super) compared: (i64, bool),
    /// Periods slipped so far; the largest number before the first state of a gate that continues.
    pub(super) slipped: u64,
    /// Joints limited in the last tick, a bit each.
    pub(super) limited: u32,
}

impl Reported {
    /// Takes over what the other gate has reported up to its last command.
    pub(super) fn follow(&mut self, last: &Command) {
        (self.missed, self.limited, self.promoted) = (last.gate.missed.into(), last.limited, None);
        self.compared = (last.tick, false);
    }
}

impl Default for Reported {
    fn default() -> Self {
        Self { promoted: None, missed: 0, compared: (-1, false), slipped: 0, limited: 0 }
    }
}
