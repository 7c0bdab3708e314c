//! What the gate does while nobody waits for it.

use crate::change_exchange::{ChangeOutcome, ChangeReply};
use crate::node::GateNode;
use hapfic_ipc::IpcError;
use hapfic_messages::{Check, Detector, EventKind, MAX_JOINTS, Process, Request};

impl GateNode {
    /// What can be done while nobody waits for it: loans, meeting those who have joined, what was not read because somebody
    /// waited, changes of the operator.
    pub(super) fn idle_work(&mut self) -> Result<(), IpcError> {
        // Parameters first: whoever joins and has a command has them, too.
        self.operator.preloan();
        self.command.preloan();
        self.event.preloan();
        self.timing.preloan();
        self.request.preloan();
        self.state.preloan();
        self.receive()?;
        self.compare()?;
        self.take_change();
        Ok(())
    }

    /// Compares what the two controllers have asked for: they compute the same function of the same inputs.
    fn compare(&mut self) -> Result<(), IpcError> {
        let last = self.gate.last().tick;
        for tick in (self.compared.0 + 1).max(last - 1)..=last {
            let (Some(a), Some(b)) = (self.inbox[0].at(tick), self.inbox[1].at(tick)) else { continue };
            let (a, b) = (*a, *b);
            // One that is no good is reported of as such.
            let differs = a.check().is_ok() && b.check().is_ok() && made(&a) != made(&b);
            let reported = std::mem::replace(&mut self.compared, (tick, differs)).1;
            if differs && !reported {
                self.report(Process::Standby, EventKind::Differs, Detector::Check, |text| {
                    let worst = (0..MAX_JOINTS).map(|i| (a.torque[i] - b.torque[i]).abs()).fold(0.0, f64::max);
                    write!(text, "controller and standby asked for different things at tick {tick}: torque by {worst:e} N m")
                })?;
            }
        }
        Ok(())
    }

    /// Takes a change that the operator requests, at most one a call: no lock, no waiting, no allocation.
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

/// What has to be the same in the requests of both controllers: all but who made them, and when.
fn made(request: &Request) -> Request {
    Request { stamp_ns: 0, controller: 0, ..*request }
}
