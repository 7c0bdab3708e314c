//! Tick in realtime: the wait for its request, and its command.

use crate::arrival_wait::{ArrivalWait, PendingTick, TIMEOUT, WakeReason};
use crate::node::GateNode;
use crate::tick_account::TickAccount;
use hapfic_gate::protocol::WaitPolicy;
use hapfic_ipc::{IpcError, allocations, clock};
use hapfic_messages::Phase;

/// Interval at which the active gate looks again for a tick that the other one owns [ns].
const BUSY_INTERVAL_NS: u64 = 20_000;

impl GateNode {
    /// Gates every tick of the run, or stands by while the other gate does. Waits in between for a request until the
    /// deadline, which counts from the state's publication.
    pub(super) fn realtime(&mut self, arrival_wait: &mut ArrivalWait, account: &mut TickAccount) -> Result<(), IpcError> {
        while self.due() && !self.stopped() {
            if !self.is_active() {
                self.follows = true;
                self.stand_by(account)?;
                continue;
            }
            if self.follows {
                self.take_over()?;
            }
            if self.attempt(account)? {
                continue;
            }
            if self.busy {
                // The other gate looks at the tick, and may leave it.
                clock::sleep_until(clock::now_ns() + BUSY_INTERVAL_NS);
                continue;
            }
            let pending = self.pending();
            self.handle_late_request(&pending)?;
            if arrival_wait.wait(&pending)? == WakeReason::WarmUp {
                self.warm_up(pending.tick);
            }
        }
        Ok(())
    }

    /// The tick to wait for.
    fn pending(&self) -> PendingTick {
        PendingTick {
            tick: self.gate.tick(),
            newest: self.received.newest,
            deadline_ns: self.start.deadline.as_nanos() as u64,
            // Without a controller no answer comes, and the start of a controller needs the processor.
            predictor: self.predictor.filter(|_| self.any_controller()),
        }
    }

    /// Gates the tick that is due, if its request has arrived or is overdue. Returns whether it is done.
    pub(super) fn attempt(&mut self, account: &mut TickAccount) -> Result<bool, IpcError> {
        // Receiving counts as well.
        let before = allocations::count();
        let done = self.own_tick(|gate, lock| {
            let tick = gate.gate.tick();
            if tick >= gate.start.ticks {
                return Ok(None);
            }
            gate.receive_until_answered(tick)?;
            let now = clock::now_ns();
            let deadline = gate.start.deadline.as_nanos() as u64;
            let overdue =
                gate.received.newest.is_some_and(|(newest, stamp)| newest > tick || (newest == tick && now >= stamp + deadline));
            if !gate.decide(overdue, WaitPolicy::Deadline) {
                return Ok(None);
            }
            gate.publish((now, before), account, lock).map(Some)
        })?;
        Ok(done.is_some())
    }

    /// Handles a late request: calls the standby, or sends heartbeats.
    fn handle_late_request(&mut self, pending: &PendingTick) -> Result<(), IpcError> {
        let Some((call, due)) = pending.call_and_due() else { return self.heartbeat(Phase::Waiting) };
        let now = clock::now_ns();
        if (call..due).contains(&now) {
            // The state is here, so its request is late: the standby has to answer.
            if pending.state_is_here() && self.called < pending.tick {
                self.called = pending.tick;
                self.ports.command_sent.notify();
            }
        } else if now > due + TIMEOUT.as_nanos() as u64 {
            // The plant's timer is late, or the plant is gone. The watchdog knows which, and a successor needs the last
            // command.
            self.idle_work()?;
            self.heartbeat(Phase::Waiting)?;
        }
        Ok(())
    }

    /// Warms up the caches: a dry run of the next tick.
    fn warm_up(&mut self, tick: i64) {
        self.ports.command.warm_up(self.gate.last());
        let primary = self.gate.primary() as usize;
        if let (Some(state), Some(request)) = (self.received.states.at(tick - 1), self.received.requests[primary].at(tick - 1)) {
            self.gate.warm_up(request, state, self.start.schedule.operator().at(tick));
        }
    }
}
