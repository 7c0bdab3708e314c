//! The pair of gates: one gates, the other keeps up and takes a tick that the first does not gate.
//!
//! Each tick has one owner, the holder of the lock of [`hapfic_ipc::GatePage`]. The state of the gate rides in the command,
//! so the next owner continues from the last command, whichever gate has published it, and computes the same bits. A gate
//! that dies with the lock leaves it to the next owner, which first takes in what the dead one has published.
//!
//! The gate that is not active wakes when the primary controller, or the supervisor, notifies it, and in realtime at half
//! of the deadline of each state. In lockstep it gates nothing before the supervisor has made it the active one.

use crate::node::GateNode;
use crate::tick_account::TickAccount;
use hapfic_gate::pair::{CatchUp, OwnerView};
use hapfic_gate::parameter_settings;
use hapfic_ipc::{GateLock, IpcError, Locked, clock, wait};
use hapfic_messages::{Check, Clock, Command, PERIOD_NS, Phase};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Longest wait of a gate that is not active.
const STAND_BY_TIMEOUT: Duration = Duration::from_millis(20);
/// Commands that a gate that takes over publishes again, at most.
const HISTORY: usize = 4;
/// Interval at which a gate that takes over looks for the lock.
const RETRY_INTERVAL: Duration = Duration::from_micros(50);
/// Looks of a successor for the lock before it starts: it takes in the last command later, too.
const MOST_TRIES: u32 = 200;

impl GateNode {
    /// Whether this gate gates at present.
    pub(crate) fn is_active(&self) -> bool {
        self.start.gates.active() == self.start.own
    }

    /// Calls `work` with the tick that is due, as its owner; `None` if another gate owns it.
    pub(crate) fn own_tick<T>(
        &mut self,
        work: impl FnOnce(&mut Self, GateLock<'_>) -> Result<Option<T>, IpcError>,
    ) -> Result<Option<T>, IpcError> {
        let gates = Arc::clone(&self.start.gates);
        let (lock, inherited) = match gates.try_lock() {
            Locked::Own(lock) => (lock, false),
            Locked::Inherited(lock) => (lock, true),
            Locked::Busy => {
                self.busy = true;
                return Ok(None);
            }
        };
        self.busy = false;
        self.catch_up(&lock, inherited)?;
        if inherited && self.start.clock == Clock::Realtime {
            // The other gate is dead: no need to wait for the supervisor.
            gates.set_active(self.start.own);
        }
        work(self, lock)
    }

    /// Takes in the other gate's last command, and in doubt publishes it: its owner may have died before.
    pub(crate) fn catch_up(&mut self, lock: &GateLock<'_>, inherited: bool) -> Result<(), IpcError> {
        let gates = Arc::clone(&self.start.gates);
        let view = OwnerView { own: self.gate.last().tick, written: gates.written(), published: gates.published(), inherited };
        let CatchUp { follow, publish } = view.catch_up();
        if !follow {
            return Ok(());
        }
        let (last, sets) = (last_commands(lock), lock.read().1);
        let (Some(command), Some(sets)) = (last.iter().flatten().next_back().copied(), sets) else { return Ok(()) };
        // Written by this program under the lock; a damaged page must not become a torque.
        if let Err(defect) = last.iter().flatten().try_for_each(Check::check).and_then(|()| sets.check()) {
            let cause = std::io::Error::other(format!("the last commands of the other gate: {defect}"));
            return Err(IpcError::System { action: "continue behind the other gate", cause });
        }
        self.gate.follow(command);
        let report = &self.start.shared.gate;
        report.mode.store(command.mode, Ordering::Relaxed);
        report.primary.store(self.gate.primary().process().code(), Ordering::Relaxed);
        report.announced.fetch_max(sets.next.version, Ordering::Relaxed);
        // Its owner may have died before it could.
        report.tick.fetch_max(command.tick, Ordering::Release);
        self.was_active |= command.gate.opened != 0;
        self.waited_ns = 0;
        self.reported.follow(&command);
        if let Some(next) = parameter_settings::settings(&sets.next) {
            self.start.schedule.follow(&sets, next);
        }
        self.take_placed();
        if publish {
            self.publish_again(last.iter().flatten())?;
        }
        Ok(())
    }

    /// Publishes the last commands and sets of another gate: for those that they have not reached, and for late joiners, for
    /// whom a dead gate has no history.
    fn publish_again<'a>(&mut self, commands: impl Iterator<Item = &'a Command>) -> Result<(), IpcError> {
        self.ports.operator.send_again(self.start.schedule.operator())?;
        for command in commands {
            let stamp_ns = if self.start.clock == Clock::Realtime { clock::now_ns() } else { 0 };
            let command = Command { stamp_ns, ..*command };
            let published = self.start.gates.published();
            // One that the other gate may not have sent is in no ring yet.
            if command.tick > published {
                self.ports.command.send(&command)?;
            } else {
                self.ports.command.send_again(&command)?;
            }
            self.ports.preloan();
            self.start.gates.set_published(command.tick.max(published));
        }
        self.ports.command_sent.notify();
        Ok(())
    }

    /// Takes the changes that the other gate has placed.
    pub(crate) fn take_placed(&mut self) {
        while let Some(change) = self.start.change_server.next_placed() {
            self.start.schedule.take_placed(&change);
        }
    }

    /// Continues behind the gate before, whose last command is in the page, with all changes that it has placed.
    pub(crate) fn resume(&mut self) -> Result<(), IpcError> {
        // It has reported what it has seen.
        self.reported.slipped = u64::MAX;
        self.follows = true;
        // Behind the last sets there is room for the changes after them.
        let mut tries = 0..MOST_TRIES;
        let take = |gate: &mut Self, _: GateLock<'_>| {
            gate.take_all_placed();
            Ok(Some(()))
        };
        while self.own_tick(take)?.is_none() && tries.next().is_some() {
            std::thread::sleep(RETRY_INTERVAL);
        }
        Ok(())
    }

    /// Takes all changes of the page. Allocates.
    fn take_all_placed(&mut self) {
        for change in self.start.change_server.all_placed() {
            self.start.schedule.take_placed(&change);
        }
    }

    /// Becomes the active gate: takes in the last command, publishes it again, and receives what it answers.
    pub(crate) fn take_over(&mut self) -> Result<(), IpcError> {
        let gates = Arc::clone(&self.start.gates);
        // The other gate is dead, or ends its tick.
        let lock = loop {
            match gates.try_lock() {
                Locked::Own(lock) | Locked::Inherited(lock) => break lock,
                Locked::Busy if self.stopped() || !self.is_active() => return Ok(()),
                Locked::Busy => std::thread::sleep(RETRY_INTERVAL),
            }
        };
        self.catch_up(&lock, false)?;
        // In any case: who joins now has no history of the dead gate.
        self.publish_again(last_commands(&lock).iter().flatten())?;
        if self.start.clock == Clock::Lockstep {
            // Nothing is in a hurry: every change that the other gate has placed.
            self.take_all_placed();
        }
        drop(lock);
        if gates.written() < 0 {
            self.begin(true)?;
        }
        self.receive()?;
        self.received.resume(self.gate.last().tick);
        self.follows = false;
        Ok(())
    }

    /// Keeps up with the other gate until it is time to look at its tick, and gates what it leaves open.
    pub(crate) fn stand_by(&mut self, account: &mut TickAccount) -> Result<(), IpcError> {
        let realtime = self.start.clock == Clock::Realtime;
        let timeout = if realtime { self.until_look() } else { STAND_BY_TIMEOUT };
        self.follows = true;
        wait(&[&self.ports.spare], timeout)?;
        if realtime {
            while !self.stopped() && self.attempt(account)? {
                if !self.is_active() {
                    self.start.shared.gate.spare_ticks.fetch_add(1, Ordering::Relaxed);
                }
            }
        }
        self.ports.preloan();
        self.receive()?;
        self.take_placed();
        self.start.change_server.leave();
        self.heartbeat_while_standing_by()
    }

    /// Time until half of the deadline of the next state.
    fn until_look(&self) -> Duration {
        let Some((newest, stamp)) = self.received.newest else { return STAND_BY_TIMEOUT };
        let now = clock::now_ns();
        let half = self.start.deadline.as_nanos() as u64 / 2;
        let mut look = stamp + half;
        if self.start.gates.published() >= newest || look <= now {
            // That state is answered, or was looked at: the next one.
            let periods = now.saturating_sub(look) / PERIOD_NS + 1;
            look += periods * PERIOD_NS;
        }
        Duration::from_nanos(look.saturating_sub(now)).min(STAND_BY_TIMEOUT)
    }

    fn heartbeat_while_standing_by(&mut self) -> Result<(), IpcError> {
        let now = clock::now_ns();
        if now - self.heartbeat_ns < STAND_BY_TIMEOUT.as_nanos() as u64 {
            return Ok(());
        }
        self.heartbeat(Phase::Running)
    }
}

/// Last commands in the page, the oldest first.
fn last_commands(lock: &GateLock<'_>) -> [Option<Command>; HISTORY] {
    let mut last = [None; HISTORY];
    for (place, command) in last.iter_mut().zip(lock.read().0) {
        *place = Some(command);
    }
    last
}
