//! The gate's thread.

use super::core::{Gate, Limits};
use super::timeline::Timeline;
use crate::live::Live;
use crate::operator::exchange::{Answer, Hatch, Verdict};
use hapfic_config::Settings;
use hapfic_ipc::message::{
    Command, Detector, Event, EventKind, Operator, Phase, Process, Request, Severity, Source, State, Timing,
};
use hapfic_ipc::realtime::{self, Granted, Wish};
use hapfic_ipc::{Bus, Check, Clock, Defect, Domain, Input, IpcError, Output, Recent, Wait, allocations, clock, topic, wait};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// How long the gate waits at most before it looks at its flags.
const PATIENCE: Duration = Duration::from_millis(20);
/// How often it looks for the word to go.
const GO_EVERY: Duration = Duration::from_millis(1);
/// How often it looks for a state that is overdue.
const LOOK_AGAIN: Duration = Duration::from_micros(500);
/// The period in nanoseconds.
const PERIOD_NS: u64 = 1_000_000;
/// Controllers: the primary and its standby.
const CONTROLLERS: usize = 2;

/// What the gate starts with.
#[derive(Debug)]
pub struct Start {
    /// The run's domain.
    pub domain: Domain,
    /// How time passes.
    pub clock: Clock,
    /// What is enforced.
    pub limits: Limits,
    /// The operator's script.
    pub timeline: Timeline,
    /// Ticks of the run.
    pub ticks: i64,
    /// How long after the state a request may come.
    pub deadline: Duration,
    /// Priority and core; `None`: no real time.
    pub wish: Option<Wish>,
    /// Where changes of the operator come in while the stack runs.
    pub hatch: Hatch,
    /// Shared with the rest of the supervisor.
    pub live: Arc<Live>,
}

impl Start {
    /// Priority and core of the gate; `shared_core` where the settings give it none.
    #[must_use]
    pub fn wish(settings: &Settings, shared_core: Option<u32>) -> Wish {
        Wish::new(settings.realtime.priority_gate, settings.realtime.core_gate.or(shared_core))
    }
}

/// The gate with its ports.
pub struct Gateway {
    pub(super) start: Start,
    pub(super) gate: Gate,
    state: Input<State>,
    request: Input<Request>,
    command: Output<Command>,
    operator: Output<Operator>,
    pub(super) event: Output<Event>,
    timing: Output<Timing>,
    /// What each controller has asked for lately: primary first.
    inbox: [Recent<Request>; CONTROLLERS],
    /// What was refused in this tick, to be told of in the slack.
    defects: [Option<(Process, Defect)>; CONTROLLERS],
    /// Newest state's tick and time of publication.
    newest: Option<(i64, u64)>,
    refused: u32,
    /// Periods slipped so far, and joints limited in the last tick.
    pub(super) slipped: u64,
    limited: u32,
    /// Periods slipped by the newest state that told of more, and how late its timer was, ns.
    pub(super) slip: (u64, u64),
    /// Time of the last heartbeat sent while waiting.
    beaten_ns: u64,
    granted: Granted,
    faults_at_start: u64,
    faults: u32,
}

impl Gateway {
    /// Opens the ports. To be called on the gate's own thread.
    ///
    /// # Errors
    /// [`IpcError`] if they cannot be had.
    pub fn open(start: Start) -> Result<Self, IpcError> {
        let bus = Bus::open(&start.domain, "gate")?;
        Ok(Self {
            gate: Gate::new(start.limits),
            state: bus.input(&topic::STATE, Wait::No)?,
            request: bus.input(&topic::REQUEST, Wait::Yes)?,
            command: bus.output(&topic::COMMAND)?,
            operator: bus.output(&topic::OPERATOR)?,
            event: bus.output(&topic::EVENT)?,
            timing: bus.output(&topic::TIMING)?,
            inbox: [Recent::default(); CONTROLLERS],
            defects: [None; CONTROLLERS],
            newest: None,
            refused: 0,
            slipped: 0,
            limited: 0,
            slip: (0, 0),
            beaten_ns: 0,
            granted: Granted::default(),
            faults_at_start: 0,
            faults: 0,
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
        self.slack();
        while self.gate.tick() < self.start.ticks && !self.stopped() {
            match self.start.clock {
                Clock::Realtime => self.realtime_tick()?,
                Clock::Lockstep => self.lockstep_tick()?,
            }
        }
        self.faults = (realtime::page_faults() - self.faults_at_start) as u32;
        self.beat(Phase::Finished)?;
        Ok(())
    }

    fn stopped(&self) -> bool {
        self.start.live.stop.load(Ordering::Acquire)
    }

    /// Waits for a request of any controller, however long it takes.
    fn lockstep_tick(&mut self) -> Result<(), IpcError> {
        loop {
            self.read()?;
            if let Some(request) = self.choose() {
                let now = clock::now_ns();
                let command = self.gate.accept(&request);
                return self.publish(&command, now, now);
            }
            self.slack();
            if self.stopped() {
                return Ok(());
            }
            if !wait(&[&self.request], PATIENCE)? {
                self.beat(Phase::Waiting)?;
            }
        }
    }

    /// Waits for a request until the deadline, which counts from the state's publication.
    fn realtime_tick(&mut self) -> Result<(), IpcError> {
        let tick = self.gate.tick();
        let deadline = self.start.deadline.as_nanos() as u64;
        loop {
            self.read()?;
            let now = clock::now_ns();
            let before = allocations::count();
            let seen = self.newest.filter(|(newest, _)| *newest >= tick);
            let command = if let Some(request) = self.choose() {
                self.gate.accept(&request)
            } else if let Some((newest, stamp)) = seen
                && (newest > tick || now >= stamp + deadline)
            {
                self.gate.miss()
            } else {
                self.wait_for_request(tick, now, deadline)?;
                if self.stopped() {
                    return Ok(());
                }
                continue;
            };
            return self.publish(&command, now, before);
        }
    }

    /// Waits for a request, at most until the deadline of `tick` as far as it can be foreseen.
    fn wait_for_request(&mut self, tick: i64, now: u64, deadline: u64) -> Result<(), IpcError> {
        let Some((newest, stamp)) = self.newest else {
            // Before the first state the plant has the word.
            if !wait(&[&self.request], PATIENCE)? {
                self.beat(Phase::Waiting)?;
            }
            return Ok(());
        };
        // A state that is still to come is due a period after the last one.
        let due = stamp + (tick - newest).max(0) as u64 * PERIOD_NS + deadline;
        if due > now {
            wait(&[&self.request], Duration::from_nanos(due - now))?;
        } else if !wait(&[&self.request], LOOK_AGAIN)? && now - due > PATIENCE.as_nanos() as u64 {
            // The plant's timer is late, or the plant is gone; the watchdog knows which.
            self.beat(Phase::Waiting)?;
        }
        Ok(())
    }

    /// Takes in what has come: states for their time, requests into the inbox.
    fn read(&mut self) -> Result<(), IpcError> {
        while let Some(state) = self.state.next()? {
            let in_order = self.newest.is_none_or(|(tick, _)| state.tick > tick) && (0..self.start.ticks).contains(&state.tick);
            if state.check().is_ok() && in_order {
                let now = clock::now_ns();
                // A stamp that cannot be right must not move the deadline.
                let stamp = if (1..=now).contains(&state.stamp_ns) { state.stamp_ns } else { now };
                self.newest = Some((state.tick, stamp));
                self.slip = self.slip.max((state.slipped, state.wake_lateness_ns));
            } else {
                self.refused += 1;
            }
        }
        while let Some(request) = self.request.next()? {
            let place = match Process::from_code(request.controller) {
                Some(Process::Controller) => 0,
                Some(Process::Standby) => 1,
                _ => {
                    self.refused += 1;
                    continue;
                }
            };
            self.inbox[place].keep(request);
        }
        Ok(())
    }

    /// The first valid request for the tick that is due, primary before standby. Those for later ticks wait.
    fn choose(&mut self) -> Option<Request> {
        let tick = self.gate.tick();
        let version = self.start.timeline.operator().at(tick).version;
        for place in 0..CONTROLLERS {
            let Some(request) = self.inbox[place].at(tick).copied() else { continue };
            match self.gate.judge(&request, version) {
                Ok(()) => return Some(request),
                Err(defect) => {
                    // Asked again at every wake-up of this tick, told once.
                    if self.defects[place].is_none() {
                        self.refused += 1;
                        self.defects[place] = Some((Process::from_code(request.controller)?, defect));
                    }
                }
            }
        }
        None
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
        self.start.live.gated.store(tick, Ordering::Release);
        for place in 0..CONTROLLERS {
            if let Some((process, defect)) = self.defects[place].take() {
                self.tell(process, EventKind::Refused, Detector::Check, |text| write!(text, "request refused: {defect}"))?;
            }
        }
        self.tell_slip()?;
        if let Some((version, from)) = announced {
            self.tell_parameters(version, from)?;
        }
        if (command.limited == 0) != (self.limited == 0) {
            self.tell_limited(command)?;
        }
        self.limited = command.limited;
        if command.severity != severity_before {
            self.tell_transition(severity_before, command.severity)?;
        }
        let missed = command.source != Source::Fresh.code() && command.source != Source::Withheld.code();
        if missed && Severity::from_code(command.severity) != Some(Severity::Nominal) {
            self.tell(Process::Controller, EventKind::Missed, Detector::Deadline, |text| {
                write!(text, "no valid request for tick {tick} by the deadline")
            })?;
        }
        let latency_ns = match self.newest {
            Some((newest, stamp)) if newest == tick && stamp > 0 => published.saturating_sub(stamp),
            _ => 0,
        };
        if tick % 1000 == 999 {
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
        self.slack();
        Ok(())
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
            ..*timing
        })?;
        Ok(())
    }

    fn slack(&mut self) {
        self.command.prepare();
        self.operator.prepare();
        self.event.prepare();
        self.timing.prepare();
        self.take_change();
    }

    /// Takes a change that the operator offers, at most one a call: no lock, no waiting, no allocation.
    fn take_change(&mut self) {
        let Some(offer) = self.start.hatch.take() else { return };
        let tick = self.gate.tick();
        let slot = self.start.timeline.slot(tick);
        let verdict = if offer.made_on.is_some_and(|version| version + 1 != slot.version) {
            Verdict::Stale
        } else if slot.effective_tick >= self.start.ticks {
            Verdict::TooLate
        } else if self.start.timeline.insert(&offer.change, tick).is_none() {
            Verdict::Full
        } else {
            Verdict::Placed
        };
        let answer = Answer::new(&offer, verdict, slot.version, slot.effective_tick, tick, slot.before);
        self.start.hatch.answer(answer);
    }
}
