//! Tick in realtime: the wait for its request, its command, and the same on the spare gate thread.

use crate::arrival_wait::{ArrivalWait, PendingTick, TIMEOUT, WakeReason};
use crate::node::GateNode;
use crate::spare::SpareGate;
use crate::tick_account::TickAccount;
use hapfic_gate::protocol::WaitPolicy;
use hapfic_ipc::{IpcError, allocations, clock};
use hapfic_messages::Phase;
use std::sync::atomic::Ordering;

impl GateNode {
    /// Gates every tick of the run. Waits in between for a request until the deadline, which counts from the state's
    /// publication. During the wait, the [spare gate thread](SpareGate) may take over.
    pub(super) fn realtime(
        self: Box<Self>,
        mut arrival_wait: ArrivalWait,
        spare: Option<SpareGate>,
        account: &mut TickAccount,
    ) -> Result<Box<Self>, IpcError> {
        let mut gate = self;
        while gate.gate.tick() < gate.start.ticks && !gate.stopped() {
            if gate.attempt(account)? {
                continue;
            }
            let pending = gate.pending();
            gate.handle_late_request(&pending)?;
            let woken = match &spare {
                Some(spare) => {
                    drop(spare.cell.put(gate));
                    let woken = arrival_wait.wait(&pending);
                    gate = spare.wait_for_gate()?;
                    woken?
                }
                None => arrival_wait.wait(&pending)?,
            };
            if let Some(error) = gate.failed.take() {
                return Err(error);
            }
            if woken == WakeReason::WarmUp {
                gate.warm_up(pending.tick);
            }
        }
        Ok(gate)
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
    fn attempt(&mut self, account: &mut TickAccount) -> Result<bool, IpcError> {
        // Receiving counts as well.
        let before = allocations::count();
        let tick = self.gate.tick();
        self.receive_until_answered(tick)?;
        let now = clock::now_ns();
        let deadline = self.start.deadline.as_nanos() as u64;
        let overdue =
            self.received.newest.is_some_and(|(newest, stamp)| newest > tick || (newest == tick && now >= stamp + deadline));
        let Some(command) = self.decide(overdue, WaitPolicy::Deadline) else { return Ok(false) };
        self.publish(&command, now, before, account)?;
        Ok(true)
    }

    /// Gates all open ticks on the spare gate thread, so that none of them delays later ones. Leaves an error to the
    /// gate's own thread.
    pub(super) fn spare_tick(&mut self, account: &mut TickAccount) {
        while self.failed.is_none() && self.gate.tick() < self.start.ticks && !self.stopped() {
            match self.attempt(account) {
                Ok(true) => {
                    self.start.shared.gate.spare_ticks.fetch_add(1, Ordering::Relaxed);
                }
                Ok(false) => return,
                Err(error) => self.failed = Some(error),
            }
        }
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
