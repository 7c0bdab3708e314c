//! A tick in realtime: waiting for its request, answering it, and doing so in place of the gate's own thread.

use crate::arrival::{Lookout, Outlook, PATIENCE, Woken};
use crate::node::Gateway;
use crate::spare::Understudy;
use hapfic_gate::protocol::Patience;
use hapfic_ipc::{IpcError, allocations, clock, realtime};
use hapfic_messages::Phase;
use std::sync::atomic::Ordering;

/// What belongs to a thread that works as the gate.
#[derive(Debug)]
pub(super) struct Hand {
    /// How often page faults are counted, in ticks, and the first tick at which they are again.
    every: i64,
    due: i64,
    /// Those that have been counted.
    faults: u64,
}

impl Hand {
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

impl Gateway {
    /// Gates every tick of the run, and waits in between: for a request until the deadline, which counts from the state's publication.
    /// While it waits, the [understudy](Understudy) may take its place.
    pub(super) fn realtime(
        self: Box<Self>,
        mut lookout: Lookout,
        understudy: Option<Understudy>,
        hand: &mut Hand,
    ) -> Result<Box<Self>, IpcError> {
        let mut gate = self;
        while gate.gate.tick() < gate.start.ticks && !gate.stopped() {
            if gate.attempt(hand)? {
                continue;
            }
            let outlook = gate.outlook();
            gate.tend(&outlook)?;
            let woken = match &understudy {
                Some(understudy) => {
                    understudy.baton.store(Some(gate));
                    let woken = lookout.wait(&outlook);
                    gate = understudy.wait_for_gate()?;
                    woken?
                }
                None => lookout.wait(&outlook)?,
            };
            if let Some(error) = gate.failed.take() {
                return Err(error);
            }
            if woken == Woken::Rehearse {
                gate.rehearse(outlook.tick);
            }
        }
        Ok(gate)
    }

    /// What there is to wait for.
    fn outlook(&self) -> Outlook {
        Outlook {
            tick: self.gate.tick(),
            newest: self.newest,
            deadline_ns: self.start.deadline.as_nanos() as u64,
            // Without a controller nothing is to be foreseen, and those who start one need the processor.
            foresight: self.foresight.filter(|_| self.any_controller()),
        }
    }

    /// Gates the tick that is due, if its request has come or is overdue. Says whether it is done.
    fn attempt(&mut self, hand: &mut Hand) -> Result<bool, IpcError> {
        // Receiving counts, too.
        let before = allocations::count();
        let tick = self.gate.tick();
        self.read_answer(tick)?;
        let now = clock::now_ns();
        let deadline = self.start.deadline.as_nanos() as u64;
        let overdue = self.newest.is_some_and(|(newest, stamp)| newest > tick || (newest == tick && now >= stamp + deadline));
        let Some(command) = self.decide(overdue, Patience::Deadline) else { return Ok(false) };
        self.publish(&command, now, before, hand)?;
        Ok(true)
    }

    /// The same in place of the gate's own thread, which hears of what went wrong: for all ticks that are open, so that one that was
    /// left over does not make all later ones late.
    pub(super) fn stand_in(&mut self, hand: &mut Hand) {
        while self.failed.is_none() && self.gate.tick() < self.start.ticks && !self.stopped() {
            match self.attempt(hand) {
                Ok(true) => {
                    self.start.live.stood_in.fetch_add(1, Ordering::Relaxed);
                }
                Ok(false) => return,
                Err(error) => self.failed = Some(error),
            }
        }
    }

    /// What is to be done about a request that is late.
    fn tend(&mut self, outlook: &Outlook) -> Result<(), IpcError> {
        let Some((call, due)) = outlook.call_and_due() else { return self.beat(Phase::Waiting) };
        let now = clock::now_ns();
        if (call..due).contains(&now) {
            // It is late, if its state is not: those in reserve are to answer.
            if outlook.state_is_here() && self.called < outlook.tick {
                self.called = outlook.tick;
                self.answered.ring();
            }
        } else if now > due + PATIENCE.as_nanos() as u64 {
            // The plant's timer is late, or the plant is gone; the watchdog knows which, and a successor needs the last command.
            self.slack()?;
            self.beat(Phase::Waiting)?;
        }
        Ok(())
    }

    /// Goes through what the next tick will need, so that it is in the caches then.
    fn rehearse(&mut self, tick: i64) {
        self.command.rehearse(self.gate.last());
        let primary = self.gate.primary() as usize;
        if let (Some(state), Some(request)) = (self.states.at(tick - 1), self.inbox[primary].at(tick - 1)) {
            self.gate.rehearse(request, state, self.start.timeline.operator().at(tick));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn page_faults_are_counted_once_in_so_many_ticks_and_each_once() {
        let mut hand = Hand::new(1000);
        let _ = hand.new_faults(0);
        // More than the allocator ever keeps for later: pages that nobody has used.
        let pages = vec![0_u8; 64 << 20];
        let used = |pages: &mut Vec<u8>| pages.iter_mut().step_by(4096).for_each(|byte| *byte = 1);
        let mut pages = std::hint::black_box(pages);
        used(&mut pages);
        assert_eq!(hand.new_faults(999), 0, "it is not asked yet");
        let found = hand.new_faults(1000);
        assert!(found > 0, "pages were used for the first time");
        assert_eq!(hand.new_faults(i64::MAX), 0, "{found} were counted before");
    }
}
