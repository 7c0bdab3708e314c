//! Ports of the gate.

use hapfic_ipc::{Bus, Doorbell, Input, IpcError, Listener, Output, Wait, topic};
use hapfic_messages::{Clock, Command, Event, Operator, Process, Request, State, Timing};

/// Inputs and outputs of the gate.
pub(super) struct GatePorts {
    pub(super) state: Input<State>,
    pub(super) request: Input<Request>,
    pub(super) command: Output<Command>,
    pub(super) operator: Output<Operator>,
    pub(super) event: Output<Event>,
    pub(super) timing: Output<Timing>,
    /// Wakes planner and standby, which do not need a state immediately.
    pub(super) command_sent: Doorbell,
    /// Wakes this gate while it is not the active one.
    pub(super) spare: Listener,
}

impl GatePorts {
    /// Opens all ports. In lockstep the gate sleeps on requests.
    pub(super) fn open(bus: &Bus, clock: Clock, own: Process) -> Result<Self, IpcError> {
        let wait = if clock == Clock::Lockstep { Wait::Yes } else { Wait::No };
        Ok(Self {
            state: bus.input(&topic::STATE, Wait::No)?,
            request: bus.input(&topic::REQUEST, wait)?,
            command: bus.kept_output(&topic::COMMAND, own, clock)?,
            operator: bus.kept_output(&topic::OPERATOR, own, clock)?,
            event: bus.kept_output(&topic::EVENT, own, clock)?,
            timing: bus.kept_output(&topic::TIMING, own, clock)?,
            command_sent: bus.doorbell(topic::COMMAND_SENT),
            spare: bus.listener(topic::SPARE_GATE),
        })
    }

    /// Loans the next samples, and connects to processes that have joined. Idle-time work.
    pub(super) fn preloan(&mut self) {
        // Parameters first: a process that has joined and gets a command has them, too.
        self.operator.preloan();
        self.command.preloan();
        self.event.preloan();
        self.timing.preloan();
        self.request.update_connections();
        self.state.update_connections();
    }
}
