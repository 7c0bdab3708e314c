//! Run of the gate: from its threads and the start flag to the last tick.

use crate::arrival_wait::{ArrivalWait, TIMEOUT};
use crate::node::{GateNode, GateStart};
use crate::spare::SpareGate;
use crate::tick_account::TickAccount;
use hapfic_gate::protocol::WaitPolicy;
use hapfic_ipc::realtime::{self, SchedGrants};
use hapfic_ipc::{ArrivalPredictor, Bus, DeadlineTimer, IpcError, clock, topic, wait};
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
    /// Waits for the start flag, then gates every tick of the run.
    ///
    /// # Errors
    /// [`IpcError`] if the ports cannot be opened, or messaging fails.
    pub fn run(start: GateStart, bus: &Bus) -> Result<(), IpcError> {
        let deadline_timer = match start.clock {
            Clock::Realtime if start.busy_poll_lead_us == 0 => Some(
                DeadlineTimer::start("hapfic-deadline", bus.doorbell(topic::REQUEST_DOORBELL), PERIOD_NS, start.deadline_timer)
                    .map_err(|cause| IpcError::System { action: "start the gate's deadline timer", cause })?,
            ),
            // A polling gate sets a time-out only once the request is late.
            _ => None,
        };
        let arrival_wait =
            ArrivalWait::new(bus.listener(topic::STATE_DOORBELL), bus.listener(topic::REQUEST_DOORBELL), deadline_timer);
        let spare = match start.spare {
            Some(sched) => Some(SpareGate::start(bus.doorbell(topic::SPARE_GATE), bus.listener(topic::SPARE_GATE), sched)?),
            None => None,
        };
        Box::new(Self::open(start, bus)?).run_loop(arrival_wait, spare)
    }

    fn run_loop(mut self: Box<Self>, arrival_wait: ArrivalWait, spare: Option<SpareGate>) -> Result<(), IpcError> {
        if let Some(sched) = self.start.sched {
            self.granted = realtime::apply_to_current_thread(sched);
            if self.granted.has(SchedGrants::FIFO) && self.granted.has(SchedGrants::PINNED) {
                self.predictor = ArrivalPredictor::new(self.start.busy_poll_lead_us);
            }
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
        self.ports.operator.send(self.start.schedule.operator())?;
        self.start.shared.gate.announced.store(self.start.schedule.operator().next.version, Ordering::Relaxed);
        let mut announced = None;
        if self.start.last.is_none() {
            announced = self.announce(-1)?;
            self.ports.command.send(self.gate.last())?;
        }
        if let Some((version, from)) = announced {
            self.report_parameters(version, from)?;
        }
        self.idle_work()?;
        let lockstep = self.start.clock == Clock::Lockstep;
        while lockstep && self.gate.tick() < self.start.ticks && !self.stopped() {
            self.lockstep_tick(&mut account)?;
        }
        if !lockstep {
            self = self.realtime(arrival_wait, spare, &mut account)?;
        }
        self.faults += account.new_faults(i64::MAX);
        self.heartbeat(Phase::Finished)?;
        // The ports stay until all other processes have done their last tick: a change of ports would delay these.
        while !self.stopped() {
            wait(&[], FLAG_POLL_INTERVAL)?;
        }
        Ok(())
    }

    /// Gates a tick in lockstep: waits for a request of every present controller, and without limit for at least one.
    fn lockstep_tick(&mut self, account: &mut TickAccount) -> Result<(), IpcError> {
        loop {
            self.receive()?;
            let now = clock::now_ns();
            // A halted gate has not waited: a gap counts as one time-out.
            self.waited_ns += now.saturating_sub(std::mem::replace(&mut self.waiting_ns, now)).min(TIMEOUT.as_nanos() as u64);
            let overdue = self.waited_ns > LOCKSTEP_TIMEOUT_NS;
            if let Some(command) = self.decide(overdue, WaitPolicy::Lockstep) {
                return self.publish(&command, now, now, account);
            }
            self.idle_work()?;
            if self.stopped() {
                return Ok(());
            }
            wait(&[&self.ports.request], TIMEOUT)?;
            // Also under repeated wake-ups without a usable request.
            self.heartbeat(Phase::Waiting)?;
        }
    }
}
