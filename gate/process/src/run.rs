//! Run of the gate: from its threads and the start flag to the last tick.

use crate::arrival_wait::{ArrivalWait, TIMEOUT};
use crate::node::{GateNode, GateStart};
use crate::tick_account::TickAccount;
use hapfic_gate::protocol::WaitPolicy;
use hapfic_ipc::realtime::{self, SchedGrants};
use hapfic_ipc::{ArrivalPredictor, Bus, DeadlineTimer, IpcError, Orphanhood, clock, topic, wait};
use hapfic_messages::{Clock, PERIOD_NS, Phase};
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Poll interval of the start and stop flags.
const FLAG_POLL_INTERVAL: Duration = Duration::from_millis(1);
/// Interval of the counts of page faults, each a system call [ticks].
const FAULTS_EVERY: i64 = 1000;
/// In lockstep: longest wait for the other controller's request while it is alive [ns].
const LOCKSTEP_TIMEOUT_NS: u64 = 2_000_000_000;

impl GateNode {
    /// Waits for the start flag, then gates every tick of the run. Returns the last look at the run's supervisor.
    ///
    /// # Errors
    /// [`IpcError`] if the ports cannot be opened, or messaging fails.
    pub fn run(start: GateStart, bus: &Bus) -> Result<Orphanhood, IpcError> {
        let deadline_timer = match start.clock {
            Clock::Realtime if start.busy_poll_lead_us == 0 => Some(
                DeadlineTimer::start("hapfic-deadline", bus.doorbell(topic::REQUEST_DOORBELL), PERIOD_NS, start.deadline_timer)
                    .map_err(|cause| IpcError::System { action: "start the gate's deadline timer", cause })?,
            ),
            // A polling gate sets a time-out only once the request is late.
            _ => None,
        };
        let mut arrival_wait =
            ArrivalWait::new(bus.listener(topic::STATE_DOORBELL), bus.listener(topic::REQUEST_DOORBELL), deadline_timer);
        let mut gate = Self::open(start, bus)?;
        gate.run_loop(&mut arrival_wait)?;
        Ok(gate.orphanhood)
    }

    fn run_loop(&mut self, arrival_wait: &mut ArrivalWait) -> Result<(), IpcError> {
        if let Some(sched) = self.start.sched {
            self.granted = realtime::apply_to_current_thread(sched);
            if self.granted.has(SchedGrants::FIFO) && self.granted.has(SchedGrants::PINNED) {
                self.predictor = ArrivalPredictor::new(self.start.busy_poll_lead_us);
            }
        }
        if self.start.generation > 0 {
            self.resume()?;
        }
        self.heartbeat(Phase::Ready)?;
        let mut last_heartbeat = clock::now_ns();
        while !self.start.shared.orders.start.load(Ordering::Acquire) {
            if self.stopped() {
                return Ok(());
            }
            if clock::now_ns() - last_heartbeat > TIMEOUT.as_nanos() as u64 {
                self.heartbeat(Phase::Ready)?;
                last_heartbeat = clock::now_ns();
            }
            wait(&[], FLAG_POLL_INTERVAL)?;
        }
        let mut account = TickAccount::new(FAULTS_EVERY);
        if self.start.generation == 0 {
            // Both gates: every receiver then knows both from the start, and has their memory at hand.
            self.begin(!self.follows)?;
        }
        self.idle_work()?;
        match self.start.clock {
            Clock::Lockstep => self.lockstep(&mut account)?,
            Clock::Realtime => self.realtime(arrival_wait, &mut account)?,
        }
        // The last command may be that of a gate that has died behind it.
        let _ = self.own_tick::<()>(|_, _| Ok(None))?;
        self.faults += account.new_faults(i64::MAX);
        self.heartbeat(Phase::Finished)?;
        // The ports stay until all other processes have done their last tick: a change of ports would delay these.
        while !self.stopped() {
            wait(&[], FLAG_POLL_INTERVAL)?;
            self.look_for_owner();
        }
        Ok(())
    }

    /// Publishes the first parameters and the command before the first tick; `reports` also their event.
    pub(super) fn begin(&mut self, reports: bool) -> Result<(), IpcError> {
        self.ports.operator.send(self.start.schedule.operator())?;
        self.start.shared.gate.announced.fetch_max(self.start.schedule.operator().next.version, Ordering::Relaxed);
        let announced = self.announce(-1)?;
        self.gate.note_announced(self.start.schedule.operator().next.version);
        self.ports.command.send(self.gate.last())?;
        if let Some((version, from)) = announced.filter(|_| reports) {
            self.report_parameters(version, from)?;
        }
        Ok(())
    }

    /// Gates every tick of the run in lockstep, or stands by while the other gate does.
    fn lockstep(&mut self, account: &mut TickAccount) -> Result<(), IpcError> {
        while self.due() && !self.stopped() {
            if !self.is_active() {
                self.follows = true;
                self.stand_by(account)?;
                continue;
            }
            if self.follows {
                self.take_over()?;
                self.waiting_ns = clock::now_ns();
            }
            self.lockstep_tick(account)?;
        }
        Ok(())
    }

    /// Whether a tick of the run is still due, for whichever gate.
    pub(super) fn due(&self) -> bool {
        self.gate.last().tick.max(self.start.gates.published()) + 1 < self.start.ticks
    }

    /// Gates a tick in lockstep: waits for a request of every present controller, and without limit for at least one.
    /// Returns also when the gate is not the active one any more.
    fn lockstep_tick(&mut self, account: &mut TickAccount) -> Result<(), IpcError> {
        loop {
            self.receive()?;
            let now = clock::now_ns();
            // A halted gate has not waited: a gap counts as one time-out.
            self.waited_ns += now.saturating_sub(std::mem::replace(&mut self.waiting_ns, now)).min(TIMEOUT.as_nanos() as u64);
            let overdue = self.waited_ns > LOCKSTEP_TIMEOUT_NS;
            let done = self.own_tick(|gate, lock| {
                // Before the decision: what is decided is published.
                if !gate.is_active() {
                    return Ok(None);
                }
                if !gate.decide(overdue, WaitPolicy::Lockstep) {
                    return Ok(None);
                }
                gate.publish((now, now), account, lock).map(Some)
            })?;
            if done.is_some() {
                return Ok(());
            }
            self.idle_work()?;
            if self.stopped() || !self.is_active() {
                return Ok(());
            }
            wait(&[&self.ports.request], TIMEOUT)?;
            // Also under repeated wake-ups without a usable request.
            self.heartbeat(Phase::Waiting)?;
        }
    }
}
