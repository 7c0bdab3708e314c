//! The gate's thread.

use super::core::{Gate, Limits};
use super::protocol::{Choice, Patience, Place, Wishes};
use super::timeline::Timeline;
use super::torque::TorqueCheck;
use crate::live::Live;
use crate::operator::exchange::Hatch;
use hapfic_ipc::clock::PERIOD_NS;
use hapfic_ipc::message::{Command, Event, Operator, Phase, Process, Request, State, Timing};
use hapfic_ipc::realtime::{self, Granted, Wish};
use hapfic_ipc::{
    Alarm, Bell, Bus, Clock, Defect, Domain, Foresight, Input, IpcError, Output, Recent, Wait, Wakes, allocations, clock, topic,
    wait,
};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// How long the gate waits at most before it looks at its flags.
const PATIENCE: Duration = Duration::from_millis(20);
/// How often it looks for the word to go.
const GO_EVERY: Duration = Duration::from_millis(1);
/// How often it looks for a state that is overdue.
const LOOK_AGAIN: Duration = Duration::from_micros(500);
/// How often page faults are counted, in ticks: a system call.
const FAULTS_EVERY: i64 = 1000;
/// Controllers: the primary and its standby.
pub(super) const CONTROLLERS: usize = 2;
/// In lockstep: how long one controller's request waits for the other's, which lives and should answer.
const LOCKSTEP_PATIENCE_NS: u64 = 2_000_000_000;
/// Ticks in a row without a request that are told of one by one.
pub(super) const TOLD_ONE_BY_ONE: u64 = 2;

/// What the gate starts with.
#[derive(Debug)]
pub struct Start {
    /// The run's domain.
    pub domain: Domain,
    /// How time passes.
    pub clock: Clock,
    /// What is enforced.
    pub limits: Limits,
    /// What torques have to agree with.
    pub torque: TorqueCheck,
    /// The operator's script.
    pub timeline: Timeline,
    /// Ticks of the run.
    pub ticks: i64,
    /// How long after the state a request may come.
    pub deadline: Duration,
    /// Priority and core; `None`: no real time.
    pub wish: Option<Wish>,
    /// The same for its alarm.
    pub alarm: Option<Wish>,
    /// How long before a state is due it begins to look out for it and the request, us; 0: it sleeps until they come. For a real-time
    /// thread on a core where neither plant nor controllers are.
    pub look_out_us: u32,
    /// Where changes of the operator come in while the stack runs.
    pub hatch: Hatch,
    /// Shared with the rest of the supervisor.
    pub live: Arc<Live>,
}

/// The gate with its ports.
pub struct Gateway {
    pub(super) start: Start,
    pub(super) gate: Gate,
    pub(super) state: Input<State>,
    pub(super) request: Input<Request>,
    pub(super) command: Output<Command>,
    pub(super) operator: Output<Operator>,
    pub(super) event: Output<Event>,
    pub(super) timing: Output<Timing>,
    /// What each controller has asked for lately: primary first.
    pub(super) inbox: [Recent<Request>; CONTROLLERS],
    /// The states they answer.
    pub(super) states: Recent<State>,
    /// What was refused lately, to be told of in the slack.
    pub(super) state_defect: Option<Defect>,
    pub(super) stray_defect: Option<Defect>,
    pub(super) defects: [Option<Defect>; CONTROLLERS],
    /// Who has just become the primary.
    pub(super) promoted: Option<Place>,
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
    pub(super) refused: u32,
    /// Periods slipped so far, and joints limited in the last tick.
    pub(super) slipped: u64,
    pub(super) limited: u32,
    /// Periods slipped by the newest state that told of more, and how late its timer was, ns.
    pub(super) slip: (u64, u64),
    /// Time of the last heartbeat sent while waiting.
    beaten_ns: u64,
    /// Rings when a request is overdue; in realtime, where the gate does not look out for it.
    alarm: Option<Alarm>,
    /// When the next request can be looked out for, if it is.
    pub(super) foresight: Option<Foresight>,
    /// Wakes those who need a state, but not at once.
    answered: Bell,
    /// Last tick for which they were woken before it was answered.
    called: i64,
    granted: Granted,
    faults_at_start: u64,
    faults: u32,
    /// First tick at which they are counted again.
    faults_due: i64,
}

impl Gateway {
    /// Opens the ports. To be called on the gate's own thread.
    ///
    /// # Errors
    /// [`IpcError`] if they cannot be had.
    pub fn open(start: Start) -> Result<Self, IpcError> {
        let bus = Bus::open(&start.domain, "gate")?;
        let alarm = match start.clock {
            Clock::Realtime if start.look_out_us == 0 => Some(
                Alarm::start("hapfic-alarm", bus.bell(topic::REQUEST_BELL), PERIOD_NS, start.alarm)
                    .map_err(|cause| IpcError::System { action: "start the gate's alarm", cause })?,
            ),
            // A time-out is only set once it is late.
            _ => None,
        };
        Ok(Self {
            gate: Gate::new(start.limits, start.torque.clone()),
            state: bus.input(&topic::STATE, Wait::Yes)?,
            request: bus.input(&topic::REQUEST, Wait::Yes)?,
            command: bus.output(&topic::COMMAND)?,
            operator: bus.output(&topic::OPERATOR)?,
            event: bus.output(&topic::EVENT)?,
            timing: bus.output(&topic::TIMING)?,
            inbox: [Recent::default(); CONTROLLERS],
            states: Recent::default(),
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
            refused: 0,
            slipped: 0,
            limited: 0,
            slip: (0, 0),
            beaten_ns: 0,
            alarm,
            foresight: None,
            answered: bus.bell(topic::ANSWERED),
            called: -1,
            granted: Granted::default(),
            faults_at_start: 0,
            faults: 0,
            faults_due: 0,
            start,
        })
    }

    /// Waits for the word to go, then gates every tick of the run.
    ///
    /// # Errors
    /// [`IpcError`] if messaging fails.
    pub fn run(&mut self) -> Result<(), IpcError> {
        if let Some(wish) = self.start.wish {
            self.granted = realtime::enter(wish);
            if self.granted.has(Granted::FIFO) && self.granted.has(Granted::PINNED) {
                self.foresight = Foresight::new(self.start.look_out_us);
            }
        }
        self.beat(Phase::Ready)?;
        let mut beaten = clock::now_ns();
        while !self.start.live.go.load(Ordering::Acquire) {
            if self.stopped() {
                return Ok(());
            }
            if clock::now_ns() - beaten > PATIENCE.as_nanos() as u64 {
                self.beat(Phase::Ready)?;
                beaten = clock::now_ns();
            }
            wait(&[], GO_EVERY)?;
        }
        self.faults_at_start = realtime::page_faults();
        self.operator.send(self.start.timeline.operator())?;
        self.start.live.announced.store(self.start.timeline.operator().next.version, Ordering::Relaxed);
        let announced = self.announce(-1)?;
        self.command.send(self.gate.last())?;
        if let Some((version, from)) = announced {
            self.tell_parameters(version, from)?;
        }
        self.slack()?;
        while self.gate.tick() < self.start.ticks && !self.stopped() {
            match self.start.clock {
                Clock::Realtime => self.realtime_tick()?,
                Clock::Lockstep => self.lockstep_tick()?,
            }
        }
        self.faults = (realtime::page_faults() - self.faults_at_start) as u32;
        self.beat(Phase::Finished)?;
        // Its ports stay until all others have done their last tick: who meets a change is held up.
        while !self.stopped() {
            wait(&[], GO_EVERY)?;
        }
        Ok(())
    }

    fn stopped(&self) -> bool {
        self.start.live.stop.load(Ordering::Acquire)
    }

    /// Waits for a request of every controller that is there, and of one in any case, however long it takes.
    fn lockstep_tick(&mut self) -> Result<(), IpcError> {
        loop {
            self.read()?;
            let now = clock::now_ns();
            if self.waiting_ns == 0 {
                self.waiting_ns = now;
            }
            let overdue = now - self.waiting_ns > LOCKSTEP_PATIENCE_NS;
            if let Some(command) = self.decide(overdue, Patience::Lockstep) {
                return self.publish(&command, now, now);
            }
            self.slack()?;
            if self.stopped() {
                return Ok(());
            }
            wait(&[&self.request], PATIENCE)?;
            // Also when it is woken again and again by what is of no use.
            self.beat(Phase::Waiting)?;
        }
    }

    /// Waits for a request until the deadline, which counts from the state's publication.
    fn realtime_tick(&mut self) -> Result<(), IpcError> {
        let tick = self.gate.tick();
        let deadline = self.start.deadline.as_nanos() as u64;
        loop {
            // Receiving counts, too.
            let before = allocations::count();
            self.read_answer(tick)?;
            let now = clock::now_ns();
            let overdue = self.newest.is_some_and(|(newest, stamp)| newest > tick || (newest == tick && now >= stamp + deadline));
            if let Some(command) = self.decide(overdue, Patience::Deadline) {
                return self.publish(&command, now, before);
            }
            self.wait_for_request(tick, deadline)?;
            if self.stopped() {
                return Ok(());
            }
        }
    }

    /// The command of the tick that is due, if it can be told by now.
    fn decide(&mut self, overdue: bool, patience: Patience) -> Option<Command> {
        let (seen, requests) = self.observe(overdue);
        let choice = self.gate.choose(&seen, patience);
        if choice == Choice::Wait {
            return None;
        }
        for place in Place::BOTH {
            let bad = &self.start.live.bad_requests[place as usize];
            if seen.refused[place as usize] {
                bad.fetch_add(1, Ordering::Relaxed);
            } else if seen.valid[place as usize] {
                bad.store(0, Ordering::Relaxed);
            }
        }
        let wishes = self.wishes();
        let primary = self.gate.primary();
        let command = match choice {
            Choice::Take(place) => {
                let request = requests[place as usize]?;
                self.gate.accept(place, &request, &seen, &wishes)
            }
            _ => self.gate.miss(&seen, &wishes),
        };
        self.promoted = (self.gate.primary() != primary).then_some(self.gate.primary());
        self.waiting_ns = 0;
        Some(command)
    }

    /// What has been asked for since the last tick.
    fn wishes(&mut self) -> Wishes {
        let live = &self.start.live;
        let (stops, rearms) = (live.stops.load(Ordering::Acquire), live.rearms.load(Ordering::Acquire));
        let wishes = Wishes {
            stop: stops != self.stops,
            rearm: rearms != self.rearms,
            // In lockstep the clock waits for whoever is missing.
            missing: self.start.clock == Clock::Realtime && live.missing.load(Ordering::Acquire) != 0,
        };
        (self.stops, self.rearms) = (stops, rearms);
        wishes
    }

    fn any_controller(&self) -> bool {
        let present = self.start.live.present.load(Ordering::Acquire);
        Place::BOTH.iter().any(|place| present & (1 << place.process().code()) != 0)
    }

    /// Waits for a request, at most until the deadline of `tick` as far as it can be foreseen.
    fn wait_for_request(&mut self, tick: i64, deadline: u64) -> Result<(), IpcError> {
        let Some((newest, stamp)) = self.newest else {
            // Before the first state the plant has the word.
            wait(&[&self.request], PATIENCE)?;
            return self.beat(Phase::Waiting);
        };
        // A state that is still to come is due a period after the last one.
        let expected = stamp + (tick - newest).max(0) as u64 * PERIOD_NS;
        let (call, due) = (expected + deadline / 2, expected + deadline);
        let limit = if newest == tick { call } else { u64::MAX };
        // Without a controller nothing is to be foreseen, and those who start one need the processor.
        if let Some(foresight) = &self.foresight
            && self.any_controller()
            && foresight.watch(&[&self.request as &dyn Wakes, &self.state], tick, limit)
        {
            return Ok(());
        }
        let now = clock::now_ns();
        if now < call {
            match &self.alarm {
                Some(alarm) => {
                    alarm.set(call);
                    wait(&[&self.request], Duration::MAX)?;
                }
                None => {
                    wait(&[&self.request], Duration::from_nanos(call - now))?;
                }
            }
        } else if now < due {
            // It is late, if its state is not: those in reserve are to answer.
            if newest == tick && self.called < tick {
                self.called = tick;
                self.answered.ring();
            }
            wait(&[&self.request], Duration::from_nanos(due - now))?;
        } else {
            wait(&[&self.request], LOOK_AGAIN)?;
            if now - due <= PATIENCE.as_nanos() as u64 {
                return Ok(());
            }
            // The plant's timer is late, or the plant is gone; the watchdog knows which, and a successor needs the last command.
            self.slack()?;
            self.beat(Phase::Waiting)?;
        }
        Ok(())
    }

    fn publish(&mut self, command: &Command, wake: u64, before: u64) -> Result<(), IpcError> {
        let tick = command.tick;
        let severity_before = self.start.live.severity.load(Ordering::Relaxed);
        let announced = self.announce(tick)?;
        let stamp = if self.start.clock == Clock::Realtime { clock::now_ns() } else { 0 };
        let published = self.command.send(&Command { stamp_ns: stamp, ..*command })?;
        let allocated = if self.start.clock == Clock::Realtime { allocations::count() - before } else { 0 };
        // From here on it is slack.
        self.start.live.severity.store(command.severity, Ordering::Relaxed);
        self.start.live.primary.store(self.gate.primary().process().code(), Ordering::Relaxed);
        self.start.live.gated.store(tick, Ordering::Release);
        self.answered.ring();
        self.tell_all(command, severity_before, announced)?;
        let latency_ns = match self.newest {
            Some((newest, stamp)) if newest == tick && stamp > 0 => published.saturating_sub(stamp),
            _ => 0,
        };
        if tick >= self.faults_due {
            self.faults_due = tick - tick % FAULTS_EVERY + FAULTS_EVERY;
            self.faults = (realtime::page_faults() - self.faults_at_start) as u32;
        }
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
        self.slack()
    }

    /// Publishes parameters whose time is near. Returns their version and first tick.
    fn announce(&mut self, tick: i64) -> Result<Option<(u64, i64)>, IpcError> {
        let Some(operator) = self.start.timeline.announce(tick) else { return Ok(None) };
        let operator = *operator;
        self.operator.send(&operator)?;
        self.start.live.announced.store(operator.next.version, Ordering::Relaxed);
        Ok(Some((operator.next.version, operator.next.effective_tick)))
    }

    fn beat(&mut self, phase: Phase) -> Result<(), IpcError> {
        let now = clock::now_ns();
        // Often enough to be heard, and not more.
        if phase == Phase::Waiting && now - self.beaten_ns < PATIENCE.as_nanos() as u64 {
            return Ok(());
        }
        self.beaten_ns = now;
        let timing = Timing { phase: phase.code(), tick: self.gate.last().tick, due_ns: now, wake_ns: now, ..Timing::default() };
        self.account(&timing)?;
        self.timing.prepare();
        Ok(())
    }

    fn account(&mut self, timing: &Timing) -> Result<(), IpcError> {
        self.timing.send(&Timing {
            process: Process::Supervisor.code(),
            refused: self.refused,
            page_faults: self.faults,
            realtime: self.granted.0,
            unmet: self.command.unmet() + self.operator.unmet() + self.request.unmet() + self.state.unmet() + self.timing.unmet(),
            ..*timing
        })?;
        Ok(())
    }
}
