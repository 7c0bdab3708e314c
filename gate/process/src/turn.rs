//! A tick in realtime: waiting for its request, answering it, and doing so in place of the gate's own thread.

use crate::arrival_wait::{ArrivalWait, PendingTick, TIMEOUT, Woken};
use crate::node::GateNode;
use crate::spare::SpareGate;
use hapfic_gate::protocol::WaitPolicy;
use hapfic_ipc::{IpcError, allocations, clock, realtime};
use hapfic_messages::Phase;
use std::sync::atomic::Ordering;

/// What belongs to a thread that works as the gate.
#[derive(Debug)]
pub(super) struct TickAccount {
    /// How often page faults are counted, in ticks, and the first tick at which they are again.
    every: i64,
    due: i64,
    /// Those that have been counted.
    faults: u64,
}

impl TickAccount {
    /// Of the calling thread.
    pub(super) fn new(every: i64) -> Self {
        Self { every, due: 0, faults: realtime::page_faults() }
    }

    /// Page faults of the calling thread since it last asked, if it is time to ask.
    pub(super) fn new_faults(&mut self, tick: i64) -> u32 {
        if tick < self.due {
            return 0;
        }
        self.due = tick.saturating_add(self.every - tick % self.every);
        let before = std::mem::replace(&mut self.faults, realtime::page_faults());
        (self.faults - before) as u32
    }
}

impl GateNode {
    /// Gates every tick of the run, and waits in between: for a request until the deadline, which counts from the state's publication.
    /// While it waits, the [spare](SpareGate) may take its place.
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
                    spare.cell.store(Some(gate));
                    let woken = arrival_wait.wait(&pending);
                    gate = spare.wait_for_gate()?;
                    woken?
                }
                None => arrival_wait.wait(&pending)?,
            };
            if let Some(error) = gate.failed.take() {
                return Err(error);
            }
            if woken == Woken::WarmUp {
                gate.warm_up(pending.tick);
            }
        }
        Ok(gate)
    }

    /// What there is to wait for.
    fn pending(&self) -> PendingTick {
        PendingTick {
            tick: self.gate.tick(),
            newest: self.newest,
            deadline_ns: self.start.deadline.as_nanos() as u64,
            // Without a controller nothing is to be foreseen, and those who start one need the processor.
            predictor: self.predictor.filter(|_| self.any_controller()),
        }
    }

    /// Gates the tick that is due, if its request has come or is overdue. Says whether it is done.
    fn attempt(&mut self, account: &mut TickAccount) -> Result<bool, IpcError> {
        // Receiving counts, too.
        let before = allocations::count();
        let tick = self.gate.tick();
        self.receive_until_answered(tick)?;
        let now = clock::now_ns();
        let deadline = self.start.deadline.as_nanos() as u64;
        let overdue = self.newest.is_some_and(|(newest, stamp)| newest > tick || (newest == tick && now >= stamp + deadline));
        let Some(command) = self.decide(overdue, WaitPolicy::Deadline) else { return Ok(false) };
        self.publish(&command, now, before, account)?;
        Ok(true)
    }

    /// The same in place of the gate's own thread, which hears of what went wrong: for all ticks that are open, so that one that was
    /// left over does not make all later ones late.
    pub(super) fn spare_tick(&mut self, account: &mut TickAccount) {
        while self.failed.is_none() && self.gate.tick() < self.start.ticks && !self.stopped() {
            match self.attempt(account) {
                Ok(true) => {
                    self.start.shared.spare_ticks.fetch_add(1, Ordering::Relaxed);
                }
                Ok(false) => return,
                Err(error) => self.failed = Some(error),
            }
        }
    }

    /// What is to be done about a request that is late.
    fn handle_late_request(&mut self, pending: &PendingTick) -> Result<(), IpcError> {
        let Some((call, due)) = pending.call_and_due() else { return self.heartbeat(Phase::Waiting) };
        let now = clock::now_ns();
        if (call..due).contains(&now) {
            // It is late, if its state is not: those in reserve are to answer.
            if pending.state_is_here() && self.called < pending.tick {
                self.called = pending.tick;
                self.answered.notify();
            }
        } else if now > due + TIMEOUT.as_nanos() as u64 {
            // The plant's timer is late, or the plant is gone; the watchdog knows which, and a successor needs the last command.
            self.idle_work()?;
            self.heartbeat(Phase::Waiting)?;
        }
        Ok(())
    }

    /// Goes through what the next tick will need, so that it is in the caches then.
    fn warm_up(&mut self, tick: i64) {
        self.command.warm_up(self.gate.last());
        let primary = self.gate.primary() as usize;
        if let (Some(state), Some(request)) = (self.states.at(tick - 1), self.inbox[primary].at(tick - 1)) {
            self.gate.warm_up(request, state, self.start.schedule.operator().at(tick));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn page_faults_are_counted_once_in_so_many_ticks_and_each_once() {
        let mut account = TickAccount::new(1000);
        let _ = account.new_faults(0);
        // More than the allocator ever keeps for later: pages that nobody has used.
        let pages = vec![0_u8; 64 << 20];
        let used = |pages: &mut Vec<u8>| pages.iter_mut().step_by(4096).for_each(|byte| *byte = 1);
        let mut pages = std::hint::black_box(pages);
        used(&mut pages);
        assert_eq!(account.new_faults(999), 0, "it is not asked yet");
        let found = account.new_faults(1000);
        assert!(found > 0, "pages were used for the first time");
        assert_eq!(account.new_faults(i64::MAX), 0, "{found} were counted before");
    }
}
