//! Idle-time work of the gate.

use crate::change_exchange::{ChangeOutcome, ChangeReply};
use crate::node::GateNode;
use hapfic_ipc::IpcError;
use hapfic_messages::{Check, Detector, EventKind, MAX_JOINTS, Process, Request};

impl GateNode {
    /// Does the idle-time work: loans, new connections, postponed reads, changes of the operator.
    pub(super) fn idle_work(&mut self) -> Result<(), IpcError> {
        self.ports.preloan();
        self.receive()?;
        self.compare()?;
        self.take_placed();
        if self.start.change_server.has_request() && self.is_active() && !self.follows {
            // As the owner of the next tick: the other gate then knows all changes before it.
            self.own_tick(|gate, _| {
                gate.take_change();
                Ok(Some(()))
            })?;
        }
        Ok(())
    }

    /// Compares the requests of the two controllers, which compute the same function of the same inputs.
    fn compare(&mut self) -> Result<(), IpcError> {
        let last = self.gate.last().tick;
        for tick in (self.reported.compared.0 + 1).max(last - 1)..=last {
            let (Some(a), Some(b)) = (self.received.requests[0].at(tick), self.received.requests[1].at(tick)) else { continue };
            let (a, b) = (*a, *b);
            // Invalid requests have an event of their own.
            let differs = a.check().is_ok() && b.check().is_ok() && content(&a) != content(&b);
            let reported = std::mem::replace(&mut self.reported.compared, (tick, differs)).1;
            if differs && !reported {
                self.report(Process::Standby, EventKind::Differs, Detector::Check, |text| {
                    let worst = (0..MAX_JOINTS).map(|i| (a.torque[i] - b.torque[i]).abs()).fold(0.0, f64::max);
                    write!(text, "requests of controller and standby differ at tick {tick}: torque by {worst:e} N m")
                })?;
            }
        }
        Ok(())
    }

    /// Takes a change of the operator, at most one for each call: no lock, no wait, no allocation.
    fn take_change(&mut self) {
        let Some(request) = self.start.change_server.take() else { return };
        let tick = self.gate.tick();
        let slot = self.start.schedule.slot(tick);
        let outcome = if request.made_on.is_some_and(|version| version + 1 != slot.version) {
            ChangeOutcome::Stale
        } else if slot.effective_tick >= self.start.ticks {
            ChangeOutcome::TooLate
        } else if self.start.schedule.insert(&request.change, tick).is_none() {
            ChangeOutcome::Full
        } else {
            ChangeOutcome::Placed
        };
        let reply = ChangeReply::new(&request, outcome, slot.version, slot.effective_tick, tick, slot.before);
        self.start.change_server.reply(reply);
    }
}

/// Content that has to be equal in the requests of both controllers: all but the sender and the time stamp.
fn content(request: &Request) -> Request {
    Request { stamp_ns: 0, controller: 0, ..*request }
}
