//! Thread of the gate.

use crate::arrival_wait::TIMEOUT;
use crate::change_exchange::ChangeServer;
use crate::ports::GatePorts;
use crate::received::{Received, Rejections};
use crate::reported::Reported;
use crate::tick_account::TickAccount;
use hapfic_gate::parameter_schedule::ParameterSchedule;
use hapfic_gate::protocol::{Choice, ControllerSlot, GateInputs, WaitPolicy};
use hapfic_gate::torque_check::TorqueCheck;
use hapfic_gate::{Gate, GateLimits};
use hapfic_ipc::SharedStatus;
use hapfic_ipc::realtime::{SchedGrants, SchedRequest};
use hapfic_ipc::{ArrivalPredictor, Bus, GateLock, GatePage, IpcError, Orphanhood, Ownership, allocations, clock};
use hapfic_messages::{Clock, Command, Detector, Mode, Phase, Process, Source, Timing};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Ticks in a row without a request that get an event each.
pub(super) const REPORTED_ONE_BY_ONE: u64 = 2;

/// Arguments of the gate.
#[derive(Debug)]
pub struct GateStart {
    /// Clock of the run.
    pub clock: Clock,
    /// Limits that the gate enforces.
    pub limits: GateLimits,
    /// Check of the requested torques.
    pub torque: TorqueCheck,
    /// Parameters and the operator's script.
    pub schedule: ParameterSchedule,
    /// Number of ticks of the run.
    pub ticks: i64,
    /// Deadline of a request, from the state's publication.
    pub deadline: Duration,
    /// Priority and core; `None`: no real time.
    pub sched: Option<SchedRequest>,
    /// Priority and core of its deadline timer; `None`: no real time.
    pub deadline_timer: Option<SchedRequest>,
    /// Busy-poll window before a state is due [us]; 0: the gate sleeps until state and request arrive. For a real-time
    /// thread on a core without plant and controllers.
    pub busy_poll_lead_us: u32,
    /// Which of the two gates this is.
    pub own: Process,
    /// Page of the two gates.
    pub gates: Arc<GatePage>,
    /// Source of the operator's changes while the stack runs.
    pub change_server: ChangeServer,
    /// Status shared with the supervisor.
    pub shared: SharedStatus,
    /// Number of the start.
    pub generation: u32,
    /// Flag of the signals that end the process.
    pub terminated: Arc<AtomicBool>,
    /// The supervisor of the run.
    pub owner: Ownership,
}

/// Gate with its ports.
pub struct GateNode {
    pub(super) start: GateStart,
    pub(super) gate: Gate,
    pub(super) ports: GatePorts,
    pub(super) received: Received,
    pub(super) rejections: Rejections,
    pub(super) reported: Reported,
    /// Time of the last look at the inputs in lockstep [ns], and waiting time of the tick that is due [ns].
    pub(super) waiting_ns: u64,
    pub(super) waited_ns: u64,
    /// Whether a command has been active.
    pub(super) was_active: bool,
    /// Time of the last heartbeat while waiting [ns].
    pub(super) heartbeat_ns: u64,
    /// Arrival predictor, if busy-poll is enabled.
    pub(super) predictor: Option<ArrivalPredictor>,
    /// Whether the other gate owned the tick at the last look.
    pub(super) busy: bool,
    /// Whether the other gate works, and this one receives now and then.
    pub(super) follows: bool,
    /// Last tick for which the gate called the standby.
    pub(super) called: i64,
    pub(super) granted: SchedGrants,
    pub(super) faults: u32,
    /// Last look at the supervisor.
    pub(super) orphanhood: Orphanhood,
}

impl GateNode {
    pub(super) fn open(start: GateStart, bus: &Bus) -> Result<Self, IpcError> {
        Ok(Self {
            ports: GatePorts::open(bus, start.clock, start.own)?,
            received: Received::default(),
            rejections: Rejections::default(),
            reported: Reported::default(),
            waiting_ns: clock::now_ns(),
            waited_ns: 0,
            was_active: false,
            gate: Gate::new(start.limits, start.torque.clone()),
            heartbeat_ns: 0,
            predictor: None,
            busy: false,
            follows: start.gates.active() != start.own,
            called: -1,
            granted: SchedGrants::default(),
            faults: 0,
            orphanhood: Orphanhood::Owned,
            start,
        })
    }

    /// Looks for the supervisor, in idle time. A run that has had none for too long lets the drive brake.
    pub(super) fn look_for_owner(&mut self) {
        let before = std::mem::replace(&mut self.orphanhood, self.start.owner.look(clock::now_ns()));
        if self.orphanhood >= Orphanhood::Brake && before < Orphanhood::Brake {
            self.start.shared.orders.stop_latched(Detector::Exit);
        }
    }

    /// Whether the gate has to end.
    pub(super) fn stopped(&self) -> bool {
        self.orphanhood >= Orphanhood::GatesEnd
            || self.start.shared.orders.stop.load(Ordering::Acquire)
            || self.start.terminated.load(Ordering::Relaxed)
    }

    /// Decides the command of the tick that is due, then the gate's last one; `false`: the gate has to wait.
    pub(super) fn decide(&mut self, overdue: bool, policy: WaitPolicy) -> bool {
        let (seen, requests) = self.observe(overdue);
        let choice = self.gate.choose(&seen, policy);
        let requested = match choice {
            Choice::Wait => return false,
            Choice::Take(slot) => requests[slot as usize].map(|request| (slot, request)),
            Choice::Miss => None,
        };
        for slot in ControllerSlot::BOTH {
            let bad = &self.start.shared.gate.rejected_requests[slot as usize];
            if seen.rejected[slot as usize] {
                bad.fetch_add(1, Ordering::Relaxed);
            } else if seen.valid[slot as usize] {
                bad.store(0, Ordering::Relaxed);
            }
        }
        let inputs = self.gate_inputs();
        let primary = self.gate.primary();
        match requested {
            Some((slot, request)) => self.gate.accept(slot, &request, &seen, &inputs),
            None => self.gate.miss(&seen, &inputs),
        };
        self.reported.promoted = (self.gate.primary() != primary).then_some(self.gate.primary());
        self.waited_ns = 0;
        true
    }

    /// Inputs of the gate since the last tick.
    fn gate_inputs(&mut self) -> GateInputs {
        let shared = &self.start.shared;
        let (stops, rearms) = (shared.orders.latched_stops.load(Ordering::Acquire), shared.orders.rearms.load(Ordering::Acquire));
        let [taken_stops, taken_rearms] = self.gate.orders();
        let inputs = GateInputs {
            stop: stops != taken_stops,
            rearm: rearms != taken_rearms,
            // In lockstep the clock waits for a missing process.
            missing: self.start.clock == Clock::Realtime && shared.presence.missing.load(Ordering::Acquire) != 0,
        };
        self.gate.take_orders(stops, rearms);
        inputs
    }

    pub(super) fn any_controller(&self) -> bool {
        let present = self.start.shared.presence.present.load(Ordering::Acquire);
        ControllerSlot::BOTH.iter().any(|slot| present & (1 << slot.process().code()) != 0)
    }

    /// Publishes the command of the tick that it has decided with the lock in hand. `begun` is the time of the look at its inputs [ns], and
    /// the number of allocations before it.
    pub(super) fn publish(
        &mut self,
        (wake, before): (u64, u64),
        account: &mut TickAccount,
        lock: GateLock<'_>,
    ) -> Result<(), IpcError> {
        let tick = self.gate.last().tick;
        let severity_before = self.start.shared.gate.severity.load(Ordering::Relaxed);
        let announced = self.announce(tick)?;
        self.gate.note_announced(self.start.schedule.operator().next.version);
        let stamp = if self.start.clock == Clock::Realtime { clock::now_ns() } else { 0 };
        lock.write(self.gate.last(), self.start.schedule.operator());
        let command = &Command { stamp_ns: stamp, ..*self.gate.last() };
        let published = self.ports.command.send(command)?;
        self.start.gates.set_published(tick);
        self.start.shared.gate.processed_stops.store(command.gate.stops, Ordering::Release);
        drop(lock);
        let allocated = if self.start.clock == Clock::Realtime { allocations::count() - before } else { 0 };
        // From here on it is idle time.
        self.start.shared.gate.severity.store(command.severity, Ordering::Relaxed);
        self.start.shared.gate.primary.store(self.gate.primary().process().code(), Ordering::Relaxed);
        self.start.shared.gate.mode.store(command.mode, Ordering::Relaxed);
        self.start.shared.gate.tick.fetch_max(tick, Ordering::Release);
        self.count(command);
        self.ports.command_sent.notify();
        self.report_all(command, severity_before, announced)?;
        let latency_ns = match self.received.newest {
            Some((newest, stamp)) if newest == tick && stamp > 0 => published.saturating_sub(stamp),
            _ => 0,
        };
        if latency_ns > 0 {
            self.start.shared.gate.latencies.push(latency_ns);
        }
        self.faults += account.new_faults(tick);
        let timing = Timing {
            phase: Phase::Running.code(),
            tick,
            due_ns: self.received.newest.map_or(0, |(_, stamp)| stamp),
            wake_ns: wake,
            publish_ns: published,
            latency_ns,
            allocations: allocated as u32,
            ..Timing::default()
        };
        self.account(&timing)?;
        self.idle_work()
    }

    /// Counts missed and braked ticks.
    fn count(&mut self, command: &Command) {
        let report = &self.start.shared.gate;
        let active = command.mode == Mode::Active.code();
        let answered = command.source == Source::Fresh.code() || command.source == Source::Suppressed.code();
        self.was_active |= active;
        if self.was_active && !answered {
            report.missed_ticks.fetch_add(1, Ordering::Relaxed);
        }
        if self.was_active && !active {
            report.braked_ticks.fetch_add(1, Ordering::Relaxed);
        }
        if self.gate.discontinuity().is_some() {
            report.discontinuities.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Announces parameters that are due. Returns their version and first tick.
    pub(super) fn announce(&mut self, tick: i64) -> Result<Option<(u64, i64)>, IpcError> {
        let Some(operator) = self.start.schedule.announce(tick) else { return Ok(None) };
        let operator = *operator;
        self.ports.operator.send(&operator)?;
        self.start.shared.gate.announced.store(operator.next.version, Ordering::Relaxed);
        Ok(Some((operator.next.version, operator.next.effective_tick)))
    }

    pub(super) fn heartbeat(&mut self, phase: Phase) -> Result<(), IpcError> {
        let now = clock::now_ns();
        // At most one heartbeat for each time-out while waiting.
        if phase == Phase::Waiting && now - self.heartbeat_ns < TIMEOUT.as_nanos() as u64 {
            return Ok(());
        }
        self.heartbeat_ns = now;
        let timing = Timing { phase: phase.code(), tick: self.gate.last().tick, due_ns: now, wake_ns: now, ..Timing::default() };
        self.account(&timing)?;
        self.ports.timing.preloan();
        Ok(())
    }

    fn account(&mut self, timing: &Timing) -> Result<(), IpcError> {
        let timing = Timing {
            process: self.start.own.code(),
            generation: self.start.generation,
            rejected: self.rejections.count,
            page_faults: self.faults,
            realtime: self.granted.0,
            failed_connections: hapfic_ipc::failed_connections(),
            ..*timing
        };
        self.start.shared.heartbeats.write(&timing, clock::now_ns());
        self.ports.timing.send(&timing)?;
        self.look_for_owner();
        Ok(())
    }
}
