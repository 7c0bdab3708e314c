//! The gate's thread.

use crate::arrival_wait::{ArrivalWait, TIMEOUT};
use crate::change_exchange::ChangeServer;
use crate::shared_status::SharedStatus;
use crate::spare::SpareGate;
use crate::turn::TickAccount;
use hapfic_gate::parameter_schedule::ParameterSchedule;
use hapfic_gate::protocol::{Choice, ControllerSlot, GateInputs, WaitPolicy};
use hapfic_gate::torque_check::TorqueCheck;
use hapfic_gate::{Gate, Limits};
use hapfic_ipc::realtime::{self, SchedGrants, SchedRequest};
use hapfic_ipc::{
    ArrivalPredictor, Bus, DeadlineTimer, Domain, Doorbell, Input, IpcError, Output, Wait, allocations, clock, topic, wait,
};
use hapfic_messages::{
    Clock, Command, Event, Operator, PERIOD_NS, Phase, Process, Request, State, TickBuffer, Timing, ValidationError,
};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// How often it looks for the word to go.
const GO_EVERY: Duration = Duration::from_millis(1);
/// How often page faults are counted, in ticks: a system call.
const FAULTS_EVERY: i64 = 1000;
/// Controllers: the primary and its standby.
pub(super) const CONTROLLERS: usize = 2;
/// In lockstep: how long one controller's request waits for the other's, which lives and should answer.
const LOCKSTEP_TIMEOUT_NS: u64 = 2_000_000_000;
/// Ticks in a row without a request that are reported of one by one.
pub(super) const REPORTED_ONE_BY_ONE: u64 = 2;

/// What the gate starts with.
#[derive(Debug)]
pub struct GateStart {
    /// The run's domain.
    pub domain: Domain,
    /// How time passes.
    pub clock: Clock,
    /// What is enforced.
    pub limits: Limits,
    /// What torques have to agree with.
    pub torque: TorqueCheck,
    /// The operator's script.
    pub schedule: ParameterSchedule,
    /// Ticks of the run.
    pub ticks: i64,
    /// How long after the state a request may come.
    pub deadline: Duration,
    /// Priority and core; `None`: no real time.
    pub wish: Option<SchedRequest>,
    /// The same for its deadline_timer.
    pub deadline_timer: Option<SchedRequest>,
    /// How long before a state is due it begins to look out for it and the request, us; 0: it sleeps until they come. For a real-time
    /// thread on a core where neither plant nor controllers are.
    pub busy_poll_lead_us: u32,
    /// Priority and core of who stands in if the gate looks out and does not come; `None`: nobody.
    pub spare: Option<SchedRequest>,
    /// Where changes of the operator come in while the stack runs.
    pub change_server: ChangeServer,
    /// Shared with the rest of the supervisor.
    pub shared: Arc<SharedStatus>,
}

/// The gate with its ports.
pub struct GateNode {
    pub(super) start: GateStart,
    pub(super) gate: Gate,
    pub(super) state: Input<State>,
    pub(super) request: Input<Request>,
    pub(super) command: Output<Command>,
    pub(super) operator: Output<Operator>,
    pub(super) event: Output<Event>,
    pub(super) timing: Output<Timing>,
    /// What each controller has asked for lately: primary first.
    pub(super) inbox: [TickBuffer<Request>; CONTROLLERS],
    /// The states they answer.
    pub(super) states: TickBuffer<State>,
    /// What was rejected lately, to be reported of in the slack.
    pub(super) state_defect: Option<ValidationError>,
    pub(super) stray_defect: Option<ValidationError>,
    pub(super) defects: [Option<ValidationError>; CONTROLLERS],
    /// Who has just become the primary.
    pub(super) promoted: Option<ControllerSlot>,
    /// When the gate began to wait for the tick that is due, ns; 0: not yet.
    waiting_ns: u64,
    /// Ticks in a row without a request.
    pub(super) missed: u64,
    /// Last tick at which the controllers' requests were compared, and whether they differed.
    pub(super) compared: (i64, bool),
    /// Stops and re-armings that have been taken in.
    stops: u64,
    rearms: u64,
    /// Newest state's tick and time of publication.
    pub(super) newest: Option<(i64, u64)>,
    pub(super) rejected: u32,
    /// Periods slipped so far, and joints limited in the last tick.
    pub(super) slipped: u64,
    pub(super) limited: u32,
    /// Periods slipped by the newest state that reported of more, and how late its timer was, ns.
    pub(super) slip: (u64, u64),
    /// Time of the last heartbeat sent while waiting.
    heartbeat_ns: u64,
    /// When the next request can be looked out for, if it is.
    pub(super) predictor: Option<ArrivalPredictor>,
    /// Wakes those who need a state, but not at once.
    pub(super) answered: Doorbell,
    /// Last tick for which they were woken before it was answered.
    pub(super) called: i64,
    granted: SchedGrants,
    faults: u32,
    /// What went wrong while the spare stood in.
    pub(super) failed: Option<IpcError>,
}

impl GateNode {
    fn open(start: GateStart, bus: &Bus) -> Result<Self, IpcError> {
        let in_step = if start.clock == Clock::Lockstep { Wait::Yes } else { Wait::No };
        Ok(Self {
            gate: Gate::new(start.limits, start.torque.clone()),
            state: bus.input(&topic::STATE, Wait::No)?,
            request: bus.input(&topic::REQUEST, in_step)?,
            command: bus.output(&topic::COMMAND)?,
            operator: bus.output(&topic::OPERATOR)?,
            event: bus.output(&topic::EVENT)?,
            timing: bus.output(&topic::TIMING)?,
            inbox: [TickBuffer::default(); CONTROLLERS],
            states: TickBuffer::default(),
            state_defect: None,
            stray_defect: None,
            defects: [None; CONTROLLERS],
            promoted: None,
            waiting_ns: 0,
            missed: 0,
            compared: (-1, false),
            stops: 0,
            rearms: 0,
            newest: None,
            rejected: 0,
            slipped: 0,
            limited: 0,
            slip: (0, 0),
            heartbeat_ns: 0,
            predictor: None,
            answered: bus.doorbell(topic::COMMAND_SENT),
            called: -1,
            granted: SchedGrants::default(),
            faults: 0,
            failed: None,
            start,
        })
    }

    /// Waits for the word to go, then gates every tick of the run. To be called on the gate's own thread.
    ///
    /// # Errors
    /// [`IpcError`] if the ports cannot be had, or messaging fails.
    pub fn run(start: GateStart) -> Result<(), IpcError> {
        let bus = Bus::open(&start.domain, "gate")?;
        let deadline_timer = match start.clock {
            Clock::Realtime if start.busy_poll_lead_us == 0 => Some(
                DeadlineTimer::start(
                    "hapfic-deadline_timer",
                    bus.doorbell(topic::REQUEST_DOORBELL),
                    PERIOD_NS,
                    start.deadline_timer,
                )
                .map_err(|cause| IpcError::System { action: "start the gate's deadline_timer", cause })?,
            ),
            // A time-out is only set once it is late.
            _ => None,
        };
        let arrival_wait =
            ArrivalWait::new(bus.listener(topic::STATE_DOORBELL), bus.listener(topic::REQUEST_DOORBELL), deadline_timer);
        let spare = match start.spare {
            Some(wish) => Some(SpareGate::start(bus.doorbell(topic::SPARE_GATE), bus.listener(topic::SPARE_GATE), wish)?),
            None => None,
        };
        Box::new(Self::open(start, &bus)?).run_loop(arrival_wait, spare)
    }

    fn run_loop(mut self: Box<Self>, arrival_wait: ArrivalWait, spare: Option<SpareGate>) -> Result<(), IpcError> {
        if let Some(wish) = self.start.wish {
            self.granted = realtime::apply_to_current_thread(wish);
            if self.granted.has(SchedGrants::FIFO) && self.granted.has(SchedGrants::PINNED) {
                self.predictor = ArrivalPredictor::new(self.start.busy_poll_lead_us);
            }
        }
        self.heartbeat(Phase::Ready)?;
        let mut last_heartbeat = clock::now_ns();
        while !self.start.shared.go.load(Ordering::Acquire) {
            if self.stopped() {
                return Ok(());
            }
            if clock::now_ns() - last_heartbeat > TIMEOUT.as_nanos() as u64 {
                self.heartbeat(Phase::Ready)?;
                last_heartbeat = clock::now_ns();
            }
            wait(&[], GO_EVERY)?;
        }
        let mut account = TickAccount::new(FAULTS_EVERY);
        self.operator.send(self.start.schedule.operator())?;
        self.start.shared.announced.store(self.start.schedule.operator().next.version, Ordering::Relaxed);
        let announced = self.announce(-1)?;
        self.command.send(self.gate.last())?;
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
        // Its ports stay until all others have done their last tick: who meets a change is held up.
        while !self.stopped() {
            wait(&[], GO_EVERY)?;
        }
        Ok(())
    }

    pub(super) fn stopped(&self) -> bool {
        self.start.shared.stop.load(Ordering::Acquire)
    }

    /// Waits for a request of every controller that is there, and of one in any case, however long it takes.
    fn lockstep_tick(&mut self, account: &mut TickAccount) -> Result<(), IpcError> {
        loop {
            self.receive()?;
            let now = clock::now_ns();
            if self.waiting_ns == 0 {
                self.waiting_ns = now;
            }
            let overdue = now - self.waiting_ns > LOCKSTEP_TIMEOUT_NS;
            if let Some(command) = self.decide(overdue, WaitPolicy::Lockstep) {
                return self.publish(&command, now, now, account);
            }
            self.idle_work()?;
            if self.stopped() {
                return Ok(());
            }
            wait(&[&self.request], TIMEOUT)?;
            // Also when it is woken again and again by what is of no use.
            self.heartbeat(Phase::Waiting)?;
        }
    }

    /// The command of the tick that is due, if it can be reported by now.
    pub(super) fn decide(&mut self, overdue: bool, patience: WaitPolicy) -> Option<Command> {
        let (seen, requests) = self.observe(overdue);
        let choice = self.gate.choose(&seen, patience);
        if choice == Choice::Wait {
            return None;
        }
        for place in ControllerSlot::BOTH {
            let bad = &self.start.shared.bad_requests[place as usize];
            if seen.rejected[place as usize] {
                bad.fetch_add(1, Ordering::Relaxed);
            } else if seen.valid[place as usize] {
                bad.store(0, Ordering::Relaxed);
            }
        }
        let inputs = self.gate_inputs();
        let primary = self.gate.primary();
        let command = match choice {
            Choice::Take(place) => {
                let request = requests[place as usize]?;
                self.gate.accept(place, &request, &seen, &inputs)
            }
            _ => self.gate.miss(&seen, &inputs),
        };
        self.promoted = (self.gate.primary() != primary).then_some(self.gate.primary());
        self.waiting_ns = 0;
        Some(command)
    }

    /// What has been asked for since the last tick.
    fn gate_inputs(&mut self) -> GateInputs {
        let shared = &self.start.shared;
        let (stops, rearms) = (shared.stops.load(Ordering::Acquire), shared.rearms.load(Ordering::Acquire));
        let inputs = GateInputs {
            stop: stops != self.stops,
            rearm: rearms != self.rearms,
            // In lockstep the clock waits for whoever is missing.
            missing: self.start.clock == Clock::Realtime && shared.missing.load(Ordering::Acquire) != 0,
        };
        (self.stops, self.rearms) = (stops, rearms);
        inputs
    }

    pub(super) fn any_controller(&self) -> bool {
        let present = self.start.shared.present.load(Ordering::Acquire);
        ControllerSlot::BOTH.iter().any(|place| present & (1 << place.process().code()) != 0)
    }

    pub(super) fn publish(
        &mut self,
        command: &Command,
        wake: u64,
        before: u64,
        account: &mut TickAccount,
    ) -> Result<(), IpcError> {
        let tick = command.tick;
        let severity_before = self.start.shared.severity.load(Ordering::Relaxed);
        let announced = self.announce(tick)?;
        let stamp = if self.start.clock == Clock::Realtime { clock::now_ns() } else { 0 };
        let published = self.command.send(&Command { stamp_ns: stamp, ..*command })?;
        let allocated = if self.start.clock == Clock::Realtime { allocations::count() - before } else { 0 };
        // From here on it is slack.
        self.start.shared.severity.store(command.severity, Ordering::Relaxed);
        self.start.shared.primary.store(self.gate.primary().process().code(), Ordering::Relaxed);
        self.start.shared.gated.store(tick, Ordering::Release);
        self.answered.notify();
        self.report_all(command, severity_before, announced)?;
        let latency_ns = match self.newest {
            Some((newest, stamp)) if newest == tick && stamp > 0 => published.saturating_sub(stamp),
            _ => 0,
        };
        self.faults += account.new_faults(tick);
        let timing = Timing {
            phase: Phase::Running.code(),
            tick,
            due_ns: self.newest.map_or(0, |(_, stamp)| stamp),
            wake_ns: wake,
            publish_ns: published,
            latency_ns,
            allocations: allocated as u32,
            ..Timing::default()
        };
        self.account(&timing)?;
        self.idle_work()
    }

    /// Publishes parameters whose time is near. Returns their version and first tick.
    fn announce(&mut self, tick: i64) -> Result<Option<(u64, i64)>, IpcError> {
        let Some(operator) = self.start.schedule.announce(tick) else { return Ok(None) };
        let operator = *operator;
        self.operator.send(&operator)?;
        self.start.shared.announced.store(operator.next.version, Ordering::Relaxed);
        Ok(Some((operator.next.version, operator.next.effective_tick)))
    }

    pub(super) fn heartbeat(&mut self, phase: Phase) -> Result<(), IpcError> {
        let now = clock::now_ns();
        // Often enough to be heard, and not more.
        if phase == Phase::Waiting && now - self.heartbeat_ns < TIMEOUT.as_nanos() as u64 {
            return Ok(());
        }
        self.heartbeat_ns = now;
        let timing = Timing { phase: phase.code(), tick: self.gate.last().tick, due_ns: now, wake_ns: now, ..Timing::default() };
        self.account(&timing)?;
        self.timing.preloan();
        Ok(())
    }

    fn account(&mut self, timing: &Timing) -> Result<(), IpcError> {
        self.timing.send(&Timing {
            process: Process::Supervisor.code(),
            rejected: self.rejected,
            page_faults: self.faults,
            realtime: self.granted.0,
            failed_connections: self.command.failed_connections()
                + self.operator.failed_connections()
                + self.request.failed_connections()
                + self.state.failed_connections()
                + self.timing.failed_connections(),
            ..*timing
        })?;
        Ok(())
    }
}
