//! The pair of gates: one gates, the other keeps up and takes a tick that the first does not gate.
//!
//! Each tick has one owner, whoever holds the lock of [`hapfic_ipc::GatePage`]. The state of the gate rides in the command,
//! so the next owner continues from the last command, whichever gate has published it, and computes the same bits. A gate
//! that dies with the lock leaves it to the next owner, which first takes in what the dead one has published.
//!
//! The gate that is not active wakes when the primary controller, or the supervisor, notifies it, and in realtime at half
//! of the deadline of each state. In lockstep it gates nothing before the supervisor has made it the active one.

use crate::node::GateNode;
use crate::tick_account::TickAccount;
use hapfic_gate::parameter_settings;
use hapfic_ipc::{GateLock, IpcError, Locked, clock, wait};
use hapfic_messages::{Check, Clock, Command, PERIOD_NS, Phase};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Longest wait of a gate that is not active.
const STAND_BY_TIMEOUT: Duration = Duration::from_millis(20);
/// Time for which a successor waits for the last command before it [ns], and interval at which it looks.
const RESUME_TIMEOUT_NS: u64 = 2_000_000_000;
const RESUME_INTERVAL: Duration = Duration::from_micros(500);

impl GateNode {
    /// Whether this gate gates at present.
    pub(crate) fn is_active(&self) -> bool {
        self.start.gates.active() == self.start.own
    }

    /// Calls `work` with the tick that is due, as its owner; `None` if another gate owns it, or if what that has published
    /// has not arrived yet.
    pub(crate) fn own_tick<T>(
        &mut self,
        work: impl FnOnce(&mut Self, GateLock<'_>) -> Result<Option<T>, IpcError>,
    ) -> Result<Option<T>, IpcError> {
        let gates = Arc::clone(&self.start.gates);
        let (lock, inherited) = match gates.try_lock() {
            Locked::Own(lock) => (lock, false),
            Locked::Inherited(lock) => (lock, true),
            Locked::Busy => return Ok(None),
        };
        if inherited || gates.published() > self.gate.last().tick {
            self.catch_up()?;
            if gates.published() > self.gate.last().tick {
                return Ok(None);
            }
        }
        if inherited {
            // The other gate is dead: no need to wait for the supervisor.
            gates.set_active(self.start.own);
        }
        work(self, lock)
    }

    /// Takes in what the other gate has published.
    pub(crate) fn catch_up(&mut self) -> Result<(), IpcError> {
        let mut newest: Option<Command> = None;
        while let Some(command) = self.ports.command_in.next()? {
            if command.tick > newest.map_or(self.gate.last().tick, |newest| newest.tick) && command.check().is_ok() {
                newest = Some(command);
            }
        }
        if let Some(command) = newest {
            self.gate.follow(command);
            self.was_active |= command.gate.opened != 0;
            self.waited_ns = 0;
            self.reported.follow(&command);
        }
        while let Some(operator) = self.ports.operator_in.next()? {
            if operator.check().is_ok()
                && let Some(next) = parameter_settings::settings(&operator.next)
            {
                self.start.schedule.follow(&operator, next);
                self.has_sets = true;
            }
        }
        while let Some(change) = self.start.change_server.next_placed() {
            self.start.schedule.take_placed(&change);
        }
        Ok(())
    }

    /// Continues behind the last command before this gate, which the supervisor has sent again.
    pub(crate) fn resume(&mut self) -> Result<(), IpcError> {
        let Some(tick) = self.start.resume else { return Ok(()) };
        self.follows = true;
        // The gate before has reported what it has seen.
        self.reported.slipped = u64::MAX;
        let begun = clock::now_ns();
        loop {
            self.keep_up()?;
            if self.gate.last().tick >= tick && self.has_sets {
                break;
            }
            if clock::now_ns() - begun > RESUME_TIMEOUT_NS {
                let cause = std::io::Error::other(format!("command {tick} or its parameters have not arrived within 2 s"));
                return Err(IpcError::System { action: "continue behind the gate before", cause });
            }
            std::thread::sleep(RESUME_INTERVAL);
        }
        for change in self.start.change_server.all_placed() {
            self.start.schedule.take_placed(&change);
        }
        self.received.resume(self.gate.last().tick);
        self.follows = !self.is_active();
        Ok(())
    }

    /// Keeps up with the other gate until it is time to look at its tick, and gates what it leaves open.
    pub(crate) fn stand_by(&mut self, account: &mut TickAccount) -> Result<(), IpcError> {
        let realtime = self.start.clock == Clock::Realtime;
        let timeout = if realtime { self.until_look() } else { STAND_BY_TIMEOUT };
        self.follows = true;
        wait(&[&self.ports.spare], timeout)?;
        if realtime {
            while self.gate.tick() < self.start.ticks && !self.stopped() && self.attempt(account)? {
                if !self.is_active() {
                    self.start.shared.gate.spare_ticks.fetch_add(1, Ordering::Relaxed);
                }
            }
        }
        self.ports.preloan();
        self.keep_up()?;
        self.start.change_server.discard();
        self.follows = !self.is_active();
        self.heartbeat_while_standing_by()
    }

    /// Takes in what the other gate has published, and what it works on.
    pub(crate) fn keep_up(&mut self) -> Result<(), IpcError> {
        self.catch_up()?;
        self.receive()
    }

    /// Time until half of the deadline of the next state.
    fn until_look(&self) -> Duration {
        let Some((newest, stamp)) = self.received.newest else { return STAND_BY_TIMEOUT };
        let now = clock::now_ns();
        let half = self.start.deadline.as_nanos() as u64 / 2;
        let mut look = stamp + half;
        if self.gate.last().tick >= newest || look <= now {
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
