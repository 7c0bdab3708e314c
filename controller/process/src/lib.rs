//! Process of a controller: state(k), reference(k) and command(k - 1) in, request(k) out.
//!
//! The process keeps no state of the law between ticks: command(k - 1) carries the state that the gate accepted. Any
//! number of controllers therefore compute the same, and a controller that starts late needs no initial state.

mod error;

pub use error::ControllerError;
use hapfic_config::Settings;
use hapfic_controller::control_step::{ControlInputs, PreviousStates, ReferenceSetpoint, control_step};
use hapfic_ipc::inject::Injector;
use hapfic_ipc::realtime::SchedRequest;
use hapfic_ipc::{Context, Doorbell, Gaps, Input, IpcError, Listener, Output, TickTimes, Wait, Wakes, clock, topic};
use hapfic_messages::{Check, Clock, Command, Operator, Process, Reference, Request, State, TickBuffer};
use hapfic_robot::Chain;
use nalgebra::Vector3;

/// Largest lag of a reference behind the newest one [ticks]; references handed over by a restarted planner lag.
const MAX_REFERENCE_LAG: i64 = 16;

/// Response time of a polling gate [ns]; by then the plant has stopped polling for the command too.
const GATE_RESPONSE_NS: u64 = 40_000;

struct ControllerPorts {
    state: Input<State>,
    reference: Input<Reference>,
    command: Input<Command>,
    operator: Input<Operator>,
    command_sent_listener: Listener,
    request: Output<Request>,
    /// Notifies the gate of each request.
    request_doorbell: Doorbell,
    /// Notifies the plant of each command.
    command_doorbell: Doorbell,
    /// Notified only by the gate: after each command, and when it calls the standby controller.
    command_sent: Doorbell,
    /// Notifies the gate that is not the active one.
    spare_gate: Doorbell,
    injector: Injector<Request>,
}

impl ControllerPorts {
    /// Idle work: preloans the next request and updates the connections.
    fn preloan(&mut self) {
        self.request.preloan();
        self.state.update_connections();
        self.reference.update_connections();
        self.command.update_connections();
    }

    /// Notifies the other gate when the active one does not respond to a request.
    fn notify_spare_gate_on_timeout(&self, command_sent: u32, published_ns: u64) {
        if self.spare_gate.has_waiters() && !self.command_sent.spin_until_changed(command_sent, published_ns + GATE_RESPONSE_NS) {
            self.spare_gate.notify();
        }
    }
}

/// Buffers of the received messages.
#[derive(Clone, Copy, Debug, Default)]
struct InputBuffers {
    /// References; the planner is one tick ahead, so the newest is not the present one.
    references: TickBuffer<Reference>,
    commands: TickBuffer<Command>,
    operator: Option<Operator>,
    /// Whether the controller has answered a state.
    has_responded: bool,
}

impl InputBuffers {
    /// Inserts a reference; returns `false` if it lags more than [`MAX_REFERENCE_LAG`].
    fn take_reference(&mut self, new: Reference) -> bool {
        let oldest = self.references.newest().map_or(i64::MIN, |newest| newest.tick.saturating_sub(MAX_REFERENCE_LAG));
        self.references.insert(new);
        new.tick > oldest
    }

    /// Returns the reference of a tick, or the last one held at rest, or (before any) the pose of the foot.
    fn setpoint(&self, state: &State) -> ReferenceSetpoint {
        if let Some(r) = self.references.at(state.tick) {
            return ReferenceSetpoint::of(r);
        }
        let before = self.references.before(state.tick).map(|r| ReferenceSetpoint::of(r).held());
        before.unwrap_or_else(|| ReferenceSetpoint::at_tip(state))
    }

    /// Whether the gate uses another controller's requests, according to the last command; initially the primary's.
    fn is_standby(&self, process: Process) -> bool {
        let used = self.commands.newest().and_then(|c| Process::from_code(c.request.controller));
        match used {
            Some(used @ (Process::Controller | Process::Standby)) => used != process,
            _ => process != Process::Controller,
        }
    }

    /// The parameter sets that hold after a command.
    fn sets(&self, command: &Command) -> Option<&Operator> {
        self.operator.as_ref().filter(|sets| sets.includes(command))
    }

    /// Whether the messages of a tick are complete: its reference, the command before it, the sets that hold after that.
    fn is_complete(&self, tick: i64) -> bool {
        self.references.at(tick).is_some() && self.commands.at(tick - 1).is_some_and(|command| self.sets(command).is_some())
    }

    /// Returns the inputs of the control step for a state; `None` if one is missing.
    fn inputs<'a>(&'a self, state: &'a State) -> Option<ControlInputs<'a>> {
        let command = self.commands.before(state.tick)?;
        let parameters = self.sets(command)?.at(state.tick);
        let (setpoint, previous) = (self.setpoint(state), PreviousStates::of(&command.request));
        Some(ControlInputs { state, setpoint, parameters, previous })
    }
}

/// Runs a controller until the last tick or the end of the process.
///
/// # Errors
/// [`ControllerError`] if the robot description is invalid or messaging fails.
pub fn run(context: &mut Context, settings: &Settings) -> Result<(), ControllerError> {
    let wait_in_lockstep = if context.clock == Clock::Lockstep { Wait::Yes } else { Wait::No };
    let mut ports = ControllerPorts {
        state: context.bus.input(&topic::STATE, Wait::Yes)?,
        reference: context.bus.input(&topic::REFERENCE, wait_in_lockstep)?,
        command: context.bus.input(&topic::COMMAND, wait_in_lockstep)?,
        operator: context.bus.input(&topic::OPERATOR, Wait::No)?,
        command_sent_listener: context.bus.listener(topic::COMMAND_SENT),
        request: context.output(&topic::REQUEST)?,
        request_doorbell: context.bus.doorbell(topic::REQUEST_DOORBELL),
        command_doorbell: context.bus.doorbell(topic::COMMAND_DOORBELL),
        command_sent: context.bus.doorbell(topic::COMMAND_SENT),
        spare_gate: context.bus.doorbell(topic::SPARE_GATE),
        injector: Injector::open(context)?,
    };
    let chain = Chain::from_settings(&settings.robot)?;
    let gravity = Vector3::from(settings.world.gravity_m_per_s2);
    // The standby has a lower priority than the primary, and its own core.
    let realtime = &settings.realtime;
    let sched_request = match context.process {
        Process::Standby => SchedRequest::new(realtime.priority_controller - 1, realtime.core_standby),
        _ => SchedRequest::new(realtime.priority_controller, realtime.core_controller),
    };
    context.ready(sched_request)?;
    context.enable_busy_poll(realtime.busy_poll_lead_us);

    let last_tick = settings.duration_ticks as i64 - 1;
    let mut buffers = InputBuffers::default();
    let mut seen = -1;
    let mut last: Option<State> = None;
    loop {
        let standby = context.clock == Clock::Realtime && buffers.is_standby(context.process);
        if !standby && context.sleep_until_window(seen + 1) {
            // The planner is one tick ahead.
            take_references(context, &mut ports.reference, &mut buffers, i64::MAX)?;
            read_ahead(context, &mut ports, &mut buffers)?;
            let inputs = last.as_ref().filter(|state| state.check().is_ok()).and_then(|state| buffers.inputs(state));
            if let Some(request) = inputs.and_then(|inputs| control_step(&chain, &gravity, &inputs, context.process)) {
                ports.request.warm_up(&request);
            }
        }
        let instead = standby.then_some(&ports.command_sent_listener as &dyn Wakes);
        let Some(state) = context.next_state(&mut ports.state, seen, Gaps::Allowed, instead, || {
            ports.request.preloan();
            ports.reference.update_connections();
            ports.command.update_connections();
            ports.operator.update_connections();
        })?
        else {
            break;
        };
        let wake = clock::now_ns();
        context.begin();
        seen = state.tick;
        let status = receive_inputs(context, &mut ports, &mut buffers, state.tick)?;
        let mut published = 0;
        let inputs = match status {
            InputStatus::Complete => buffers.inputs(&state),
            InputStatus::TooLate => None,
            InputStatus::End => break,
        };
        match inputs.and_then(|inputs| control_step(&chain, &gravity, &inputs, context.process)) {
            Some(request) => {
                buffers.has_responded = true;
                let request = Request { stamp_ns: context.stamp(), ..request };
                // A polling gate responds immediately, on another core, so the plant can wake up meanwhile.
                let gate_polls = !standby && ports.request_doorbell.is_polled();
                let command_sent = ports.command_sent.count();
                published = ports.injector.send(&mut ports.request, &request, state.tick)?;
                if gate_polls {
                    ports.command_doorbell.notify();
                }
                if !standby && published > 0 {
                    ports.notify_spare_gate_on_timeout(command_sent, published);
                }
            }
            None if matches!(status, InputStatus::TooLate) => {}
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
        // Messages that follow the request are received now, not while the gate waits for the next request.
        read_ahead(context, &mut ports, &mut buffers)?;
        ports.injector.listen()?;
        if state.tick >= last_tick {
            context.finish(state.tick)?;
            break;
        }
    }
    Ok(())
}

/// Result of waiting for the messages of a tick.
enum InputStatus {
    /// All messages are present; in realtime: all that arrived so far.
    Complete,
    /// The tick is done: another controller has answered it.
    TooLate,
    /// The process must end.
    End,
}

/// Receives messages that precede their state: command(k) at the end of tick k, parameters some ticks ahead.
fn read_ahead(context: &mut Context, ports: &mut ControllerPorts, buffers: &mut InputBuffers) -> Result<(), IpcError> {
    context.drain(&mut ports.command, |new| buffers.commands.insert(new))?;
    context.drain(&mut ports.operator, |new| Operator::take_newer(&mut buffers.operator, new))
}

/// Receives references up to that of a tick, and counts outdated ones as rejected.
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
    // A controller that has just joined receives the history, whose old references do not count.
    for _ in 0..if buffers.has_responded { late } else { 0 } {
        context.reject();
    }
    Ok(())
}

/// Receives all inputs; in lockstep waits for reference(k) and command(k - 1), or for command(k), which ends tick k.
fn receive_inputs(
    context: &mut Context,
    ports: &mut ControllerPorts,
    buffers: &mut InputBuffers,
    tick: i64,
) -> Result<InputStatus, IpcError> {
    loop {
        if context.clock == Clock::Lockstep || buffers.references.at(tick).is_none() {
            take_references(context, &mut ports.reference, buffers, tick)?;
        }
        let command = buffers.commands.at(tick - 1);
        if context.clock == Clock::Lockstep || command.is_none_or(|command| buffers.sets(command).is_none()) {
            read_ahead(context, ports, buffers)?;
        }
        if context.clock == Clock::Realtime {
            return Ok(InputStatus::Complete);
        }
        if buffers.commands.newest().is_some_and(|c| c.tick >= tick) {
            return Ok(InputStatus::TooLate);
        }
        if buffers.is_complete(tick) {
            return Ok(InputStatus::Complete);
        }
        ports.request.preloan();
        if !context.wait(&[&ports.reference, &ports.command], tick)? {
            return Ok(InputStatus::End);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_messages::{GateState, Parameters};

    fn sets(version: u64, effective_tick: i64) -> Operator {
        let set = |version, effective_tick| Parameters { version, effective_tick, ..Parameters::default() };
        Operator { current: set(version - 1, 0), next: set(version, effective_tick) }
    }

    #[test]
    fn inputs_wait_for_sets_that_command_announces() {
        let state = State { tick: 40, ..State::default() };
        let mut buffers = InputBuffers::default();
        buffers.references.insert(Reference { tick: 40, ..Reference::default() });
        buffers.commands.insert(Command {
            tick: 39,
            gate: GateState { announced: 3, ..GateState::default() },
            ..Command::default()
        });
        assert!(!buffers.is_complete(40) && buffers.inputs(&state).is_none(), "no sets");
        // From the history of the other gate, which has gated nothing since.
        Operator::take_newer(&mut buffers.operator, sets(2, 10));
        assert!(!buffers.is_complete(40) && buffers.inputs(&state).is_none(), "old sets");
        Operator::take_newer(&mut buffers.operator, sets(3, 40));
        assert!(buffers.is_complete(40));
        assert_eq!(buffers.inputs(&state).unwrap().parameters.version, 3);
        Operator::take_newer(&mut buffers.operator, sets(2, 10));
        assert_eq!(buffers.inputs(&state).unwrap().parameters.version, 3, "the old ones come last");
    }
}
