//! The torque gate without its thread: turns requests, or the lack of them, into commands.

use crate::conditioning::Conditioning;
use crate::limits::GateLimits;
use crate::protocol::{Choice, ControllerSlot, GateInputs, Observation, Protocol, TickAction, WaitPolicy};
use crate::severity::Conditions;
use crate::torque_check::TorqueCheck;
use hapfic_messages::{
    Check, Command, ControllerState, GateState, MAX_JOINTS, Mode, Parameters, Process, Request, RotationRequest, Severity,
    Source, State, ValidationError,
};

/// A step of a joint's torque from one tick to the next, larger than [`GateLimits::discontinuity`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueStep {
    /// Index of the joint, from the base.
    pub joint: usize,
    /// New torque minus old torque [N m].
    pub size: f64,
}

/// The gate's state from tick to tick.
#[derive(Clone, Debug)]
pub struct Gate {
    limits: GateLimits,
    check: TorqueCheck,
    conditioning: Conditioning,
    protocol: Protocol,
    step: Option<TorqueStep>,
    /// Latched stops and re-armings taken in.
    orders: [u64; 2],
    /// Version of the newest parameter set announced.
    announced: u64,
    last: Command,
}

impl Gate {
    /// Gate before its first tick.
    #[must_use]
    pub fn new(limits: GateLimits, check: TorqueCheck) -> Self {
        let first = Command {
            tick: -1,
            mode: Mode::Hold.code(),
            source: Source::None.code(),
            severity: Severity::Nominal.code(),
            joints: limits.joints as u32,
            limbs: 1,
            request: Request {
                tick: -1,
                state_tick: -1,
                controller: Process::Gate.code(),
                joints: limits.joints as u32,
                limbs: 1,
                ..Request::default()
            },
            ..Command::default()
        };
        Self {
            limits,
            check,
            conditioning: Conditioning::default(),
            protocol: Protocol::default(),
            step: None,
            orders: [0; 2],
            announced: 0,
            last: first,
        }
    }

    /// Gate that continues behind the command of another gate, which passed its [`Check`]: it computes the same commands
    /// from the same requests.
    #[must_use]
    pub fn resume(limits: GateLimits, check: TorqueCheck, last: Command) -> Self {
        let mut gate = Self::new(limits, check);
        gate.follow(last);
        gate
    }

    /// Continues behind the command of another gate. No call waits or allocates.
    pub fn follow(&mut self, last: Command) {
        let state = &last.gate;
        let conditions = Conditions { missed: state.missed, good: state.good, ..Conditions::default() };
        self.protocol = Protocol {
            primary: if state.primary == 0 { ControllerSlot::First } else { ControllerSlot::Second },
            misses: state.misses,
            severity: Severity::from_code(last.severity).unwrap_or(Severity::Stopped),
            conditions,
            opened: state.opened != 0,
        };
        self.conditioning = Conditioning::from_carried(state.filtered, state.ramping != 0);
        self.orders = [state.stops, state.rearms];
        self.announced = state.announced;
        self.step = None;
        self.last = Command { stamp_ns: 0, ..last };
    }

    /// Latched stops and re-armings that the gate has taken in so far.
    #[must_use]
    pub fn orders(&self) -> [u64; 2] {
        self.orders
    }

    /// Notes the latched stops and re-armings that the inputs of the next tick stand for.
    pub fn take_orders(&mut self, stops: u64, rearms: u64) {
        self.orders = [stops, rearms];
    }

    /// Notes in the last command the newest parameter set announced before it goes out.
    pub fn note_announced(&mut self, version: u64) {
        self.announced = version;
        self.last.gate.announced = version;
    }

    /// State that the next command carries.
    fn carried(&self) -> GateState {
        let (filtered, ramping) = self.conditioning.carried();
        let Protocol { primary, misses, conditions, opened, .. } = self.protocol;
        GateState {
            filtered,
            stops: self.orders[0],
            rearms: self.orders[1],
            announced: self.announced,
            ramping: ramping.into(),
            primary: primary as u32,
            misses,
            missed: conditions.missed,
            good: conditions.good,
            opened: opened.into(),
        }
    }

    /// The last command; before the first tick, the initial command: brakes on, controller state cleared.
    #[must_use]
    pub fn last(&self) -> &Command {
        &self.last
    }

    /// The severity after the last tick.
    #[must_use]
    pub fn severity(&self) -> Severity {
        self.protocol.severity
    }

    /// Slot whose request counts if both controllers have answered.
    #[must_use]
    pub fn primary(&self) -> ControllerSlot {
        self.protocol.primary
    }

    /// The tick whose command is due.
    #[must_use]
    pub fn tick(&self) -> i64 {
        self.last.tick + 1
    }

    /// The largest step of a joint's torque in the last command, if it exceeds [`GateLimits::discontinuity`].
    #[must_use]
    pub fn discontinuity(&self) -> Option<TorqueStep> {
        self.step
    }

    /// Validates a request for the tick that is due, given its state and the parameters in force.
    ///
    /// # Errors
    /// The first defect found.
    pub fn validate(&self, request: &Request, state: &State, parameters: &Parameters) -> Result<(), ValidationError> {
        request.check()?;
        let same = |field, found: i64, expected: i64| {
            if found == expected { Ok(()) } else { Err(ValidationError::Tick { field, found, expected }) }
        };
        same("tick", request.tick, self.tick())?;
        same("state_tick", request.state_tick, self.tick())?;
        let count = |field, found: u64, expected: u64| {
            if found == expected { Ok(()) } else { Err(ValidationError::Count { field, found, expected }) }
        };
        count("joints", request.joints.into(), self.limits.joints as u64)?;
        count("parameters_version", request.parameters_version, parameters.version)?;
        match Process::from_code(request.controller) {
            Some(Process::Controller | Process::Standby) => {}
            _ => return Err(ValidationError::Code { field: "controller", found: request.controller }),
        }
        self.check.check(state, request, parameters)
    }

    /// Warms up the caches: a dry run of a request, without effect.
    pub fn warm_up(&self, request: &Request, state: &State, parameters: &Parameters) {
        let valid = state.check().is_ok() && request.check().is_ok();
        let checked = self.check.check(state, request, parameters).is_ok();
        let conditioned = self.conditioning.step(&request.torque, &self.last.torque, &self.limits);
        std::hint::black_box((valid, checked, conditioned));
    }

    /// Chooses what to do about the tick that is due.
    #[must_use]
    pub fn choose(&self, seen: &Observation, policy: WaitPolicy) -> Choice {
        self.protocol.choose(seen, policy)
    }

    /// Makes the command of the tick that is due from a slot's request, which passed [`validate`](Self::validate).
    pub fn accept(&mut self, slot: ControllerSlot, request: &Request, seen: &Observation, inputs: &GateInputs) -> Command {
        match self.advance(Choice::Take(slot), seen, inputs) {
            Some(TickAction::Pass(_)) => self.pass(request),
            _ => self.brake(Source::Suppressed),
        }
    }

    /// Makes the command of the tick that is due without a valid request: first repeats the last command, then brakes.
    pub fn miss(&mut self, seen: &Observation, inputs: &GateInputs) -> Command {
        match self.advance(Choice::Miss, seen, inputs) {
            Some(TickAction::Hold) => {
                // No torque has been commanded yet: the drive's own brakes hold, also after the end of a stop.
                self.publish(Command { mode: Mode::Hold.code(), source: Source::None.code(), ..self.last })
            }
            Some(TickAction::Repeat) => self.publish(Command { source: Source::Repeated.code(), ..self.last }),
            _ => self.brake(Source::None),
        }
    }

    fn advance(&mut self, choice: Choice, seen: &Observation, inputs: &GateInputs) -> Option<TickAction> {
        let (protocol, action) = self.protocol.step(choice, seen, inputs);
        self.protocol = protocol;
        self.step = None;
        action
    }

    /// Makes a command from a request, with its torque conditioned.
    fn pass(&mut self, request: &Request) -> Command {
        let was_active = self.last.mode == Mode::Active.code();
        if self.last.mode >= Mode::Brake.code() {
            self.conditioning = Conditioning::after_brake();
        }
        let (conditioning, conditioned) = self.conditioning.step(&request.torque, &self.last.torque, &self.limits);
        self.conditioning = conditioning;
        let torque = conditioned.torque;
        if was_active {
            self.step = self.largest_step(&torque);
        }
        self.publish(Command {
            mode: Mode::Active.code(),
            source: Source::Fresh.code(),
            limited: conditioned.limited,
            ramped: conditioned.ramped,
            rate_limited: conditioned.rate_limited,
            torque,
            request: Request { stamp_ns: 0, ..*request },
            ..self.last
        })
    }

    fn largest_step(&self, torque: &[f64; MAX_JOINTS]) -> Option<TorqueStep> {
        (0..self.limits.joints)
            .map(|joint| TorqueStep { joint, size: torque[joint] - self.last.torque[joint] })
            .filter(|step| step.size.abs() > self.limits.discontinuity)
            .max_by(|a, b| a.size.abs().total_cmp(&b.size.abs()))
    }

    /// Makes a braking command: controllers and filter start anew from a cleared state.
    fn brake(&mut self, source: Source) -> Command {
        self.conditioning = Conditioning::default();
        let mode = if self.severity() == Severity::Stopped { Mode::Stopped } else { Mode::Brake };
        let mut request = self.last.request;
        request.state = ControllerState::default();
        request.torque = [0.0; MAX_JOINTS];
        request.joint_space_torque = [0.0; MAX_JOINTS];
        request.force = [0.0; 3];
        request.rotation = RotationRequest::default();
        self.publish(Command {
            mode: mode.code(),
            source: source.code(),
            limited: 0,
            ramped: 0,
            rate_limited: 0,
            torque: [0.0; MAX_JOINTS],
            request,
            ..self.last
        })
    }

    fn publish(&mut self, command: Command) -> Command {
        let (tick, severity) = (self.tick(), self.severity().code());
        self.last = Command { stamp_ns: 0, tick, severity, gate: self.carried(), ..command };
        self.last
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
