//! The torque gate without its thread: from requests, or their absence, to commands.

use super::severity::{Conditions, severity};
use hapfic_controller::conditioning::{LowPass, limit};
use hapfic_ipc::message::{Command, ControllerState, MAX_JOINTS, Mode, Process, Request, Severity, Source};
use hapfic_ipc::{Check, Defect};

/// What the gate enforces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Joints of the robot.
    pub joints: usize,
    /// Bandwidth of the torque filter, Hz; `None`: no filter.
    pub bandwidth_hz: Option<f64>,
    /// Peak of each joint's torque.
    pub peak: [f64; MAX_JOINTS],
    /// Length of a tick, s.
    pub period_s: f64,
}

/// The gate's state from tick to tick.
#[derive(Clone, Debug)]
pub struct Gate {
    limits: Limits,
    filter: LowPass,
    severity: Severity,
    conditions: Conditions,
    last: Command,
    /// Whether any request was ever accepted.
    opened: bool,
}

impl Gate {
    /// A gate that has seen nothing yet.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        let first = Command {
            tick: -1,
            mode: Mode::Hold.code(),
            source: Source::None.code(),
            severity: Severity::Nominal.code(),
            joints: limits.joints as u32,
            request: Request {
                tick: -1,
                state_tick: -1,
                controller: Process::Supervisor.code(),
                joints: limits.joints as u32,
                ..Request::default()
            },
            ..Command::default()
        };
        Self {
            limits,
            filter: LowPass::default(),
            severity: Severity::Nominal,
            conditions: Conditions::default(),
            last: first,
            opened: false,
        }
    }

    /// The last command; before the first tick, the one that starts everything: brakes on, controller state cleared.
    #[must_use]
    pub fn last(&self) -> &Command {
        &self.last
    }

    /// How bad it is.
    #[must_use]
    pub fn severity(&self) -> Severity {
        self.severity
    }

    /// The tick whose command is due.
    #[must_use]
    pub fn tick(&self) -> i64 {
        self.last.tick + 1
    }

    /// Whether a request may be used for the tick that is due, under a version of the parameters.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn judge(&self, request: &Request, version: u64) -> Result<(), Defect> {
        request.check()?;
        let same = |field, found: i64, expected: i64| {
            if found == expected { Ok(()) } else { Err(Defect::Tick { field, found, expected }) }
        };
        same("tick", request.tick, self.tick())?;
        same("state_tick", request.state_tick, self.tick())?;
        let count = |field, found: u64, expected: u64| {
            if found == expected { Ok(()) } else { Err(Defect::Count { field, found, expected }) }
        };
        count("joints", request.joints.into(), self.limits.joints as u64)?;
        count("parameters_version", request.parameters_version, version)?;
        match Process::from_code(request.controller) {
            Some(Process::Controller | Process::Standby) => Ok(()),
            _ => Err(Defect::Code { field: "controller", found: request.controller }),
        }
    }

    /// The command of the tick that is due, from a request that [`judge`](Self::judge) let pass.
    pub fn accept(&mut self, request: &Request) -> Command {
        self.opened = true;
        self.step(0, self.conditions.good.saturating_add(1));
        if self.severity >= Severity::Brake {
            return self.brake(Source::Withheld);
        }
        self.filter = self.filter.step(&request.torque, self.limits.bandwidth_hz, self.limits.period_s);
        let (torque, limited) = limit(&self.filter.output, &self.limits.peak);
        self.publish(Command {
            mode: Mode::Active.code(),
            source: Source::Fresh.code(),
            limited,
            torque,
            request: Request { stamp_ns: 0, ..*request },
            ..self.last
        })
    }

    /// The command of the tick that is due when no valid request came in time: the last one once more, then brake.
    pub fn miss(&mut self) -> Command {
        if !self.opened {
            // Nothing has ever been commanded: the drive's own brakes hold.
            return self.publish(Command { source: Source::None.code(), ..self.last });
        }
        self.step(self.conditions.missed.saturating_add(1), 0);
        if self.severity >= Severity::Brake {
            return self.brake(Source::None);
        }
        self.publish(Command { source: Source::Repeated.code(), ..self.last })
    }

    fn step(&mut self, missed: u32, good: u32) {
        self.conditions = Conditions { missed, good, ..self.conditions };
        self.severity = severity(self.severity, &self.conditions);
    }

    /// Controllers start anew from a cleared state, and so does the filter.
    fn brake(&mut self, source: Source) -> Command {
        self.filter = LowPass::default();
        let mode = if self.severity == Severity::Stopped { Mode::Stopped } else { Mode::Brake };
        let mut request = self.last.request;
        request.state = ControllerState::default();
        request.torque = [0.0; MAX_JOINTS];
        request.force = [0.0; 3];
        self.publish(Command {
            mode: mode.code(),
            source: source.code(),
            limited: 0,
            torque: [0.0; MAX_JOINTS],
            request,
            ..self.last
        })
    }

    fn publish(&mut self, command: Command) -> Command {
        self.last = Command { stamp_ns: 0, tick: self.tick(), severity: self.severity.code(), ..command };
        self.last
    }
}

#[cfg(test)]
mod tests {
    use super::super::severity::CLEAR_AFTER;
    use super::*;

    fn gate(bandwidth_hz: Option<f64>) -> Gate {
        Gate::new(Limits { joints: 3, bandwidth_hz, peak: [40.0; MAX_JOINTS], period_s: 1e-3 })
    }

    fn request(tick: i64, torque: f64) -> Request {
        let mut all = [0.0; MAX_JOINTS];
        all[..3].fill(torque);
        Request {
            tick,
            state_tick: tick,
            parameters_version: 1,
            controller: Process::Controller.code(),
            joints: 3,
            torque: all,
            state: ControllerState { offset: [0.001; 3], ..ControllerState::default() },
            ..Request::default()
        }
    }

    fn feed(gate: &mut Gate, torque: f64) -> Command {
        let request = request(gate.tick(), torque);
        assert_eq!(gate.judge(&request, 1), Ok(()));
        gate.accept(&request)
    }

    #[test]
    fn it_starts_with_a_command_that_holds_the_brakes_at_tick_minus_one() {
        let mut gate = gate(None);
        assert_eq!((gate.last().tick, gate.last().mode), (-1, Mode::Hold.code()));
        let command = gate.miss();
        assert_eq!((command.tick, command.mode, command.severity), (0, Mode::Hold.code(), 0));
    }

    #[test]
    fn the_peak_limits_and_says_which_joint() {
        let mut gate = gate(None);
        let mut request = request(0, 10.0);
        request.torque[1] = -55.0;
        let command = gate.accept(&request);
        assert_eq!(&command.torque[..3], &[10.0, -40.0, 10.0]);
        assert_eq!(command.limited, 0b010);
        assert_eq!(command.request.torque[1], -55.0);
        assert_eq!(command.request.state.offset, [0.001; 3]);
    }

    #[test]
    fn the_filter_has_its_bandwidth() {
        let mut gate = gate(Some(20.0));
        let alpha = 1.0 - (-2.0 * std::f64::consts::PI * 20.0 * 1e-3_f64).exp();
        assert!((feed(&mut gate, 10.0).torque[0] - 10.0 * alpha).abs() < 1e-12);
        for _ in 0..200 {
            feed(&mut gate, 10.0);
        }
        assert!((gate.last().torque[0] - 10.0).abs() < 1e-9);
    }

    #[test]
    fn one_miss_repeats_and_the_second_brakes_until_twenty_good_ticks() {
        let mut gate = gate(None);
        feed(&mut gate, 7.0);
        let repeated = gate.miss();
        assert_eq!((repeated.mode, repeated.source, repeated.torque[0]), (Mode::Active.code(), Source::Repeated.code(), 7.0));
        assert_eq!(gate.severity(), Severity::Degraded);
        let braked = gate.miss();
        assert_eq!((braked.mode, braked.torque[0]), (Mode::Brake.code(), 0.0));
        assert_eq!(braked.request.state, ControllerState::default(), "controllers start anew");
        for good in 1..=CLEAR_AFTER {
            let command = feed(&mut gate, 3.0);
            let active = command.mode == Mode::Active.code();
            assert_eq!(active, good == CLEAR_AFTER, "after {good} good ticks");
        }
        assert_eq!(gate.last().tick, 2 + i64::from(CLEAR_AFTER));
    }

    #[test]
    fn requests_of_another_tick_version_or_shape_are_refused() {
        let gate = gate(None);
        let good = request(0, 1.0);
        assert_eq!(gate.judge(&good, 1), Ok(()));
        for bad in [
            Request { tick: 1, ..good },
            Request { state_tick: -1, ..good },
            Request { parameters_version: 2, ..good },
            Request { joints: 4, ..good },
            Request { controller: Process::Plant.code(), ..good },
            Request { force: [f64::NAN, 0.0, 0.0], ..good },
            Request { torque: [f64::INFINITY; MAX_JOINTS], ..good },
        ] {
            assert!(gate.judge(&bad, 1).is_err(), "{bad:?}");
        }
    }
}
