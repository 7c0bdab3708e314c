//! The controller as a process: state(k), reference(k) and command(k - 1) in, request(k) out.
//!
//! It keeps nothing from tick to tick: the controller's state comes with the command, as the gate accepted it. So any number of
//! controllers compute the same, and one that starts late needs no seeding.

mod error;

pub use error::ControllerError;
use hapfic_config::Settings;
use hapfic_controller::answer::{Known, answer};
use hapfic_ipc::inject::Injector;
use hapfic_ipc::realtime::Wish;
use hapfic_ipc::{Bell, Context, Gaps, Input, IpcError, Listener, Output, Tick, Wait, Wakes, clock, topic};
use hapfic_messages::{Check, Clock, Command, Operator, Process, Recent, Reference, Request, State};
use hapfic_robot::Chain;
use nalgebra::Vector3;

/// Ticks by which a reference may be behind the newest: those that are handed over when a planner is started again are.
const OLD: i64 = 16;

/// How soon a gate that looks out has answered a request, ns. By then the plant has given up looking out for the command, too.
const GATED_WITHIN_NS: u64 = 40_000;

struct Ports {
    state: Input<State>,
    reference: Input<Reference>,
    command: Input<Command>,
    operator: Input<Operator>,
    answered: Listener,
    request: Output<Request>,
    /// Rung for the gate with each request.
    request_bell: Bell,
    /// Rung for the plant with each command.
    command_bell: Bell,
    /// Rung by the gate alone: after each command, and when it calls those in reserve.
    gated: Bell,
    /// Rung for the gate's understudy.
    understudy: Bell,
    injector: Injector<Request>,
}

impl Ports {
    /// Work for the slack: the next loan, and meeting those who have joined.
    fn prepare(&mut self) {
        self.request.prepare();
        self.state.prepare();
        self.reference.prepare();
        self.command.prepare();
    }

    /// Calls the gate's understudy, if there is one, should the gate not answer what was published.
    fn see_it_gated(&self, gated: u32, published_ns: u64) {
        if self.understudy.is_slept_on() && !self.gated.rings_after(gated, published_ns + GATED_WITHIN_NS) {
            self.understudy.ring();
        }
    }

    fn unmet(&self) -> u32 {
        self.request.unmet() + self.state.unmet() + self.reference.unmet() + self.command.unmet() + self.operator.unmet()
    }
}

/// What has come in.
#[derive(Clone, Copy, Debug, Default)]
struct Inbox {
    /// The planner is one tick ahead, so the newest is not the one to follow.
    references: Recent<Reference>,
    commands: Recent<Command>,
    operator: Option<Operator>,
    /// Whether a state has been answered.
    joined: bool,
}

impl Inbox {
    /// Takes a reference; `false` if it is older than all that are kept.
    fn follow(&mut self, new: Reference) -> bool {
        let oldest = self.references.newest().map_or(i64::MIN, |newest| newest.tick.saturating_sub(OLD));
        self.references.keep(new);
        new.tick > oldest
    }

    /// The reference to follow at a tick: its own, or the last one held at rest, or (before any) where the foot is.
    fn setpoint(&self, state: &State) -> ([f64; 3], [f64; 3]) {
        if let Some(r) = self.references.at(state.tick) {
            return (r.position, r.velocity);
        }
        let held = self.references.before(state.tick).map_or(state.foot_position, |r| r.position);
        (held, [0.0; 3])
    }

    /// Whether the gate uses another controller's requests, as far as the last command tells. At first it uses the primary's.
    fn answers_come_from_elsewhere(&self, process: Process) -> bool {
        let used = self.commands.newest().and_then(|c| Process::from_code(c.request.controller));
        match used {
            Some(used @ (Process::Controller | Process::Standby)) => used != process,
            _ => process != Process::Controller,
        }
    }

    /// What there is to answer a state with; `None` if something is missing.
    fn known<'a>(&'a self, state: &'a State) -> Option<Known<'a>> {
        let parameters = self.operator.as_ref()?.at(state.tick);
        let command = self.commands.before(state.tick)?;
        let (reference_position, reference_velocity) = self.setpoint(state);
        Some(Known { state, reference_position, reference_velocity, parameters, carried: command.request.state })
    }
}

/// Runs a controller until its last tick or its end.
///
/// # Errors
/// [`ControllerError`] if the robot description is no good or messaging fails.
pub fn run(context: &mut Context, settings: &Settings) -> Result<(), ControllerError> {
    let in_step = if context.clock == Clock::Lockstep { Wait::Yes } else { Wait::No };
    let mut ports = Ports {
        state: context.bus.input(&topic::STATE, Wait::Yes)?,
        reference: context.bus.input(&topic::REFERENCE, in_step)?,
        command: context.bus.input(&topic::COMMAND, in_step)?,
        operator: context.bus.input(&topic::OPERATOR, Wait::No)?,
        answered: context.bus.listener(topic::ANSWERED),
        request: context.bus.output(&topic::REQUEST)?,
        request_bell: context.bus.bell(topic::REQUEST_BELL),
        command_bell: context.bus.bell(topic::COMMAND_BELL),
        gated: context.bus.bell(topic::ANSWERED),
        understudy: context.bus.bell(topic::UNDERSTUDY),
        injector: Injector::open(context)?,
    };
    let chain = Chain::from_settings(&settings.robot)?;
    let gravity = Vector3::from(settings.world.gravity_m_per_s2);
    // The standby gives way to the primary, and is out of its way.
    let realtime = &settings.realtime;
    let wish = match context.process {
        Process::Standby => Wish::new(realtime.priority_controller - 1, realtime.core_standby),
        _ => Wish::new(realtime.priority_controller, realtime.core_controller),
    };
    context.ready(wish)?;
    context.look_out(realtime.look_out_us);

    let last_tick = settings.duration_ticks as i64 - 1;
    let mut inbox = Inbox::default();
    let mut seen = -1;
    let mut last: Option<State> = None;
    loop {
        let in_reserve = context.clock == Clock::Realtime && inbox.answers_come_from_elsewhere(context.process);
        if !in_reserve && context.approach(seen + 1) {
            // It is one tick ahead.
            follow(context, &mut ports.reference, &mut inbox, i64::MAX)?;
            read_ahead(context, &mut ports, &mut inbox)?;
            let known = last.as_ref().filter(|state| state.check().is_ok()).and_then(|state| inbox.known(state));
            if let Some(request) = known.and_then(|known| answer(&chain, &gravity, &known, context.process)) {
                ports.request.rehearse(&request);
            }
        }
        let instead = in_reserve.then_some(&ports.answered as &dyn Wakes);
        let Some(state) = context.next_state(&mut ports.state, seen, Gaps::Allowed, instead, || {
            ports.request.prepare();
            ports.reference.prepare();
            ports.command.prepare();
            ports.operator.prepare();
        })?
        else {
            break;
        };
        let wake = clock::now_ns();
        context.begin();
        seen = state.tick;
        let filled = fill(context, &mut ports, &mut inbox, state.tick)?;
        let mut published = 0;
        let known = match filled {
            Filled::Complete => inbox.known(&state),
            Filled::TooLate => None,
            Filled::End => break,
        };
        match known.and_then(|known| answer(&chain, &gravity, &known, context.process)) {
            Some(request) => {
                inbox.joined = true;
                let request = Request { stamp_ns: context.stamp(), ..request };
                // A gate that is awake answers at once, on another core: the plant may as well wake up meanwhile.
                let at_once = !in_reserve && ports.request_bell.is_watched();
                let gated = ports.gated.count();
                published = ports.injector.send(&mut ports.request, &request, state.tick)?;
                if at_once {
                    ports.command_bell.ring();
                }
                if !in_reserve && published > 0 {
                    ports.see_it_gated(gated, published);
                }
            }
            None if matches!(filled, Filled::TooLate) => {}
            None => context.refuse(),
        }
        context.account(Tick {
            tick: state.tick,
            due_ns: state.stamp_ns,
            wake_ns: wake,
            publish_ns: published,
            latency_ns: 0,
        })?;
        last = Some(state);
        ports.prepare();
        // What comes after the answer need not be looked for while somebody waits for the next.
        read_ahead(context, &mut ports, &mut inbox)?;
        context.tell_unmet(ports.unmet());
        ports.injector.listen()?;
        if state.tick >= last_tick {
            context.finish(state.tick)?;
            break;
        }
    }
    Ok(())
}

/// What came of waiting for a tick's messages.
enum Filled {
    /// All are there; in realtime: all that will be.
    Complete,
    /// The tick is done: another controller has answered it.
    TooLate,
    /// The process should end.
    End,
}

/// Takes in what is known before the state it belongs to: command(k) at the end of tick k, parameters some ticks ahead.
fn read_ahead(context: &mut Context, ports: &mut Ports, inbox: &mut Inbox) -> Result<(), IpcError> {
    context.drain(&mut ports.command, |new| inbox.commands.keep(new))?;
    context.drain(&mut ports.operator, |new| inbox.operator = Some(new))
}

/// Takes references up to that of a tick, and counts those that are too old.
fn follow(context: &mut Context, references: &mut Input<Reference>, inbox: &mut Inbox, tick: i64) -> Result<(), IpcError> {
    let mut late = 0;
    context.take_until(references, |new| {
        late += u32::from(!inbox.follow(new));
        new.tick >= tick
    })?;
    // Who has just joined is handed over what was said long ago.
    for _ in 0..if inbox.joined { late } else { 0 } {
        context.refuse();
    }
    Ok(())
}

/// Takes what there is; in lockstep waits for reference(k) and command(k - 1), or for command(k): then tick k is done.
fn fill(context: &mut Context, ports: &mut Ports, inbox: &mut Inbox, tick: i64) -> Result<Filled, IpcError> {
    loop {
        if context.clock == Clock::Lockstep || inbox.references.at(tick).is_none() {
            follow(context, &mut ports.reference, inbox, tick)?;
        }
        if context.clock == Clock::Lockstep || inbox.commands.at(tick - 1).is_none() || inbox.operator.is_none() {
            read_ahead(context, ports, inbox)?;
        }
        if context.clock == Clock::Realtime {
            return Ok(Filled::Complete);
        }
        if inbox.commands.newest().is_some_and(|c| c.tick >= tick) {
            return Ok(Filled::TooLate);
        }
        if inbox.references.at(tick).is_some() && inbox.commands.at(tick - 1).is_some() && inbox.operator.is_some() {
            return Ok(Filled::Complete);
        }
        ports.request.prepare();
        if !context.wait(&[&ports.reference, &ports.command], tick)? {
            return Ok(Filled::End);
        }
    }
}
