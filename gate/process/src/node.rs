//! The gate's thread.

use crate::arrival::{Lookout, PATIENCE};
use crate::change_exchange::Hatch;
use crate::shared_status::Live;
use crate::spare::Understudy;
use crate::turn::Hand;
use hapfic_gate::parameter_schedule::Timeline;
use hapfic_gate::protocol::{Choice, Patience, Place, Wishes};
use hapfic_gate::torque_check::TorqueCheck;
use hapfic_gate::{Gate, Limits};
use hapfic_ipc::realtime::{self, Granted, Wish};
use hapfic_ipc::{Alarm, Bell, Bus, Domain, Foresight, Input, IpcError, Output, Wait, allocations, clock, topic, wait};
use hapfic_messages::{Clock, Command, Defect, Event, Operator, PERIOD_NS, Phase, Process, Recent, Request, State, Timing};
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
    /// Priority and core of who stands in if the gate looks out and does not come; `None`: nobody.
    pub understudy: Option<Wish>,
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
    /// When the next request can be looked out for, if it is.
    pub(super) foresight: Option<Foresight>,
    /// Wakes those who need a state, but not at once.
    pub(super) answered: Bell,
    /// Last tick for which they were woken before it was answered.
    pub(super) called: i64,
    granted: Granted,
    faults: u32,
    /// What went wrong while the understudy stood in.
    pub(super) failed: Option<IpcError>,
}

impl Gateway {
    fn open(start: Start, bus: &Bus) -> Result<Self, IpcError> {
        let in_step = if start.clock == Clock::Lockstep { Wait::Yes } else { Wait::No };
        Ok(Self {
            gate: Gate::new(start.limits, start.torque.clone()),
            state: bus.input(&topic::STATE, Wait::No)?,
            request: bus.input(&topic::REQUEST, in_step)?,
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
            foresight: None,
            answered: bus.bell(topic::ANSWERED),
            called: -1,
            granted: Granted::default(),
            faults: 0,
            failed: None,
            start,
        })
    }

    /// Waits for the word to go, then gates every tick of the run. To be called on the gate's own thread.
    ///
    /// # Errors
    /// [`IpcError`] if the ports cannot be had, or messaging fails.
    pub fn run(start: Start) -> Result<(), IpcError> {
        let bus = Bus::open(&start.domain, "gate")?;
        let alarm = match start.clock {
            Clock::Realtime if start.look_out_us == 0 => Some(
                Alarm::start("hapfic-alarm", bus.bell(topic::REQUEST_BELL), PERIOD_NS, start.alarm)
                    .map_err(|cause| IpcError::System { action: "start the gate's alarm", cause })?,
            ),
            // A time-out is only set once it is late.
            _ => None,
        };
        let lookout = Lookout::new(bus.listener(topic::STATE_BELL), bus.listener(topic::REQUEST_BELL), alarm);
        let understudy = match start.understudy {
            Some(wish) => Some(Understudy::start(bus.bell(topic::UNDERSTUDY), bus.listener(topic::UNDERSTUDY), wish)?),
            None => None,
        };
        Box::new(Self::open(start, &bus)?).go(lookout, understudy)
    }

    fn go(mut self: Box<Self>, lookout: Lookout, understudy: Option<Understudy>) -> Result<(), IpcError> {
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
        let mut hand = Hand::new(FAULTS_EVERY);
        self.operator.send(self.start.timeline.operator())?;
        self.start.live.announced.store(self.start.timeline.operator().next.version, Ordering::Relaxed);
        let announced = self.announce(-1)?;
        self.command.send(self.gate.last())?;
        if let Some((version, from)) = announced {
            self.tell_parameters(version, from)?;
        }
        self.slack()?;
        let lockstep = self.start.clock == Clock::Lockstep;
        while lockstep && self.gate.tick() < self.start.ticks && !self.stopped() {
            self.lockstep_tick(&mut hand)?;
        }
        if !lockstep {
            self = self.realtime(lookout, understudy, &mut hand)?;
        }
        self.faults += hand.new_faults(i64::MAX);
        self.beat(Phase::Finished)?;
        // Its ports stay until all others have done their last tick: who meets a change is held up.
        while !self.stopped() {
            wait(&[], GO_EVERY)?;
        }
        Ok(())
    }

    pub(super) fn stopped(&self) -> bool {
        self.start.live.stop.load(Ordering::Acquire)
    }

    /// Waits for a request of every controller that is there, and of one in any case, however long it takes.
    fn lockstep_tick(&mut self, hand: &mut Hand) -> Result<(), IpcError> {
        loop {
            self.read()?;
            let now = clock::now_ns();
            if self.waiting_ns == 0 {
                self.waiting_ns = now;
            }
            let overdue = now - self.waiting_ns > LOCKSTEP_PATIENCE_NS;
            if let Some(command) = self.decide(overdue, Patience::Lockstep) {
                return self.publish(&command, now, now, hand);
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

    /// The command of the tick that is due, if it can be told by now.
    pub(super) fn decide(&mut self, overdue: bool, patience: Patience) -> Option<Command> {
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

    pub(super) fn any_controller(&self) -> bool {
        let present = self.start.live.present.load(Ordering::Acquire);
        Place::BOTH.iter().any(|place| present & (1 << place.process().code()) != 0)
    }

    pub(super) fn publish(&mut self, command: &Command, wake: u64, before: u64, hand: &mut Hand) -> Result<(), IpcError> {
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
        self.faults += hand.new_faults(tick);
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

    pub(super) fn beat(&mut self, phase: Phase) -> Result<(), IpcError> {
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
