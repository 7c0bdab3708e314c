//! The controller as a process: state(k), reference(k) and command(k - 1) in, request(k) out.
//!
//! It keeps nothing from tick to tick: the controller's state comes with the command, as the gate accepted it. So any number of
//! controllers compute the same, and one that starts late needs no seeding.

mod error;

pub use error::ControllerError;
use hapfic_config::Settings;
use hapfic_controller::control_step::{ControlInputs, control_step};
use hapfic_ipc::inject::Injector;
use hapfic_ipc::realtime::SchedRequest;
use hapfic_ipc::{Context, Doorbell, Gaps, Input, IpcError, Listener, Output, TickTimes, Wait, Wakes, clock, topic};
use hapfic_messages::{Check, Clock, Command, Operator, Process, Reference, Request, State, TickBuffer};
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
    request_bell: Doorbell,
    /// Rung for the plant with each command.
    command_bell: Doorbell,
    /// Rung by the gate alone: after each command, and when it calls those in reserve.
    gated: Doorbell,
    /// Rung for the gate's spare.
    spare: Doorbell,
    injector: Injector<Request>,
}

impl Ports {
    /// Work for the idle_work: the next loan, and meeting those who have joined.
    fn preloan(&mut self) {
        self.request.preloan();
        self.state.preloan();
        self.reference.preloan();
        self.command.preloan();
    }

    /// Calls the gate's spare, if there is one, should the gate not answer what was published.
    fn call_spare_if_unanswered(&self, gated: u32, published_ns: u64) {
        if self.spare.has_waiters() && !self.gated.spin_until_changed(gated, published_ns + GATED_WITHIN_NS) {
            self.spare.notify();
        }
    }

    fn failed_connections(&self) -> u32 {
        self.request.failed_connections()
            + self.state.failed_connections()
            + self.reference.failed_connections()
            + self.command.failed_connections()
            + self.operator.failed_connections()
    }
}

/// What has come in.
#[derive(Clone, Copy, Debug, Default)]
struct InputBuffers {
    /// The planner is one tick ahead, so the newest is not the one to follow.
    references: TickBuffer<Reference>,
    commands: TickBuffer<Command>,
    operator: Option<Operator>,
    /// Whether a state has been answered.
    joined: bool,
}

impl InputBuffers {
    /// Takes a reference; `false` if it is older than all that are kept.
    fn take_reference(&mut self, new: Reference) -> bool {
        let oldest = self.references.newest().map_or(i64::MIN, |newest| newest.tick.saturating_sub(OLD));
        self.references.insert(new);
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
    fn inputs<'a>(&'a self, state: &'a State) -> Option<ControlInputs<'a>> {
        let parameters = self.operator.as_ref()?.at(state.tick);
        let command = self.commands.before(state.tick)?;
        let (reference_position, reference_velocity) = self.setpoint(state);
        Some(ControlInputs { state, reference_position, reference_velocity, parameters, previous_state: command.request.state })
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
        answered: context.bus.listener(topic::COMMAND_SENT),
        request: context.bus.output(&topic::REQUEST)?,
        request_bell: context.bus.doorbell(topic::REQUEST_DOORBELL),
        command_bell: context.bus.doorbell(topic::COMMAND_DOORBELL),
        gated: context.bus.doorbell(topic::COMMAND_SENT),
        spare: context.bus.doorbell(topic::SPARE_GATE),
        injector: Injector::open(context)?,
    };
    let chain = Chain::from_settings(&settings.robot)?;
    let gravity = Vector3::from(settings.world.gravity_m_per_s2);
    // The standby gives way to the primary, and is out of its way.
    let realtime = &settings.realtime;
    let wish = match context.process {
        Process::Standby => SchedRequest::new(realtime.priority_controller - 1, realtime.core_standby),
        _ => SchedRequest::new(realtime.priority_controller, realtime.core_controller),
    };
    context.ready(wish)?;
    context.enable_busy_poll(realtime.busy_poll_lead_us);

    let last_tick = settings.duration_ticks as i64 - 1;
    let mut buffers = InputBuffers::default();
    let mut seen = -1;
    let mut last: Option<State> = None;
    loop {
        let standby = context.clock == Clock::Realtime && buffers.answers_come_from_elsewhere(context.process);
        if !standby && context.sleep_until_window(seen + 1) {
            // It is one tick ahead.
            take_references(context, &mut ports.reference, &mut buffers, i64::MAX)?;
            read_ahead(context, &mut ports, &mut buffers)?;
            let inputs = last.as_ref().filter(|state| state.check().is_ok()).and_then(|state| buffers.inputs(state));
            if let Some(request) = inputs.and_then(|inputs| control_step(&chain, &gravity, &inputs, context.process)) {
                ports.request.warm_up(&request);
            }
        }
        let instead = standby.then_some(&ports.answered as &dyn Wakes);
        let Some(state) = context.next_state(&mut ports.state, seen, Gaps::Allowed, instead, || {
            ports.request.preloan();
            ports.reference.preloan();
            ports.command.preloan();
            ports.operator.preloan();
        })?
        else {
            break;
        };
        let wake = clock::now_ns();
        context.begin();
        seen = state.tick;
        let filled = receive_inputs(context, &mut ports, &mut buffers, state.tick)?;
        let mut published = 0;
        let inputs = match filled {
            InputStatus::Complete => buffers.inputs(&state),
            InputStatus::TooLate => None,
            InputStatus::End => break,
        };
        match inputs.and_then(|inputs| control_step(&chain, &gravity, &inputs, context.process)) {
            Some(request) => {
                buffers.joined = true;
                let request = Request { stamp_ns: context.stamp(), ..request };
                // A gate that is awake answers at once, on another core: the plant may as well wake up meanwhile.
                let at_once = !standby && ports.request_bell.is_polled();
                let gated = ports.gated.count();
                published = ports.injector.send(&mut ports.request, &request, state.tick)?;
                if at_once {
                    ports.command_bell.notify();
                }
                if !standby && published > 0 {
                    ports.call_spare_if_unanswered(gated, published);
                }
            }
            None if matches!(filled, InputStatus::TooLate) => {}
            None => context.reject(),
        }
        context.account(TickTimes {
            tick: state.tick,
            due_ns: state.stamp_ns,
            wake_ns: wake,
            publish_ns: published,
            latency_ns: 0,
        })?;
        last = Some(state);
        ports.preloan();
        // What comes after the answer need not be looked for while somebody waits for the next.
        read_ahead(context, &mut ports, &mut buffers)?;
        context.report_failed_connections(ports.failed_connections());
        ports.injector.listen()?;
        if state.tick >= last_tick {
            context.finish(state.tick)?;
            break;
        }
    }
    Ok(())
}

/// What came of waiting for a tick's messages.
enum InputStatus {
    /// All are there; in realtime: all that will be.
    Complete,
    /// The tick is done: another controller has answered it.
    TooLate,
    /// The process should end.
    End,
}

/// Takes in what is inputs before the state it belongs to: command(k) at the end of tick k, parameters some ticks ahead.
fn read_ahead(context: &mut Context, ports: &mut Ports, buffers: &mut InputBuffers) -> Result<(), IpcError> {
    context.drain(&mut ports.command, |new| buffers.commands.insert(new))?;
    context.drain(&mut ports.operator, |new| buffers.operator = Some(new))
}

/// Takes references up to that of a tick, and counts those that are too old.
fn take_references(
    context: &mut Context,
    references: &mut Input<Reference>,
    buffers: &mut InputBuffers,
    tick: i64,
) -> Result<(), IpcError> {
    let mut late = 0;
    context.take_until(references, |new| {
        late += u32::from(!buffers.take_reference(new));
        new.tick >= tick
    })?;
    // Who has just joined is handed over what was said long ago.
    for _ in 0..if buffers.joined { late } else { 0 } {
        context.reject();
    }
    Ok(())
}

/// Takes what there is; in lockstep waits for reference(k) and command(k - 1), or for command(k): then tick k is done.
fn receive_inputs(
    context: &mut Context,
    ports: &mut Ports,
    buffers: &mut InputBuffers,
    tick: i64,
) -> Result<InputStatus, IpcError> {
    loop {
        if context.clock == Clock::Lockstep || buffers.references.at(tick).is_none() {
            take_references(context, &mut ports.reference, buffers, tick)?;
        }
        if context.clock == Clock::Lockstep || buffers.commands.at(tick - 1).is_none() || buffers.operator.is_none() {
            read_ahead(context, ports, buffers)?;
        }
        if context.clock == Clock::Realtime {
            return Ok(InputStatus::Complete);
        }
        if buffers.commands.newest().is_some_and(|c| c.tick >= tick) {
            return Ok(InputStatus::TooLate);
        }
        if buffers.references.at(tick).is_some() && buffers.commands.at(tick - 1).is_some() && buffers.operator.is_some() {
            return Ok(InputStatus::Complete);
        }
        ports.request.preloan();
        if !context.wait(&[&ports.reference, &ports.command], tick)? {
            return Ok(InputStatus::End);
        }
    }
}
