//! Inputs of the gate: states, for their time and for the torque check, and requests of both controllers.

use crate::node::GateNode;
use crate::received::CONTROLLERS;
use hapfic_gate::protocol::{ControllerSlot, Observation};
use hapfic_ipc::{IpcError, clock};
use hapfic_messages::{Check, Clock, PERIOD_NS, Process, Request, State, ValidationError};
use std::sync::atomic::Ordering;

/// Largest distance of a request's tick from the tick that is due.
const NEAR: i64 = 8;

impl GateNode {
    /// Receives all states and requests.
    pub(super) fn receive(&mut self) -> Result<(), IpcError> {
        while let Some(state) = self.ports.state.next()? {
            self.take_state(state);
        }
        while let Some(request) = self.ports.request.next()? {
            self.take_request(request);
        }
        Ok(())
    }

    /// Receives up to the state of a tick and the primary's request; the rest can wait for idle time.
    pub(super) fn receive_until_answered(&mut self, tick: i64) -> Result<(), IpcError> {
        while self.received.newest.is_none_or(|(newest, _)| newest < tick)
            && let Some(state) = self.ports.state.next()?
        {
            self.take_state(state);
        }
        let primary = self.gate.primary() as usize;
        while self.received.requests[primary].at(tick).is_none()
            && let Some(request) = self.ports.request.next()?
        {
            self.take_request(request);
        }
        Ok(())
    }

    fn take_state(&mut self, state: State) {
        let again = |tick| state.tick == tick || self.received.resumed.is_some_and(|resumed| state.tick <= resumed);
        if self.received.newest.is_some_and(|(tick, _)| again(tick)) && state.check().is_ok() {
            // A successor of the plant republishes the last state of its predecessor.
            return;
        }
        match self.validate_state(&state) {
            Ok(()) => {
                let now = clock::now_ns();
                // An implausible stamp must not move the deadline.
                let stamp = state.stamp_ns.clamp(now.saturating_sub(PERIOD_NS), now);
                self.received.newest = Some((state.tick, stamp));
                if let Some(predictor) = &mut self.predictor {
                    predictor.observe(&state, now);
                }
                self.received.states.insert(state);
                self.received.slip = self.received.slip.max((state.slipped, state.wake_lateness_ns));
            }
            // The other gate reports it.
            Err(_) if self.follows => {}
            Err(defect) => {
                self.rejections.count += 1;
                self.rejections.state = Some(defect);
            }
        }
    }

    fn take_request(&mut self, request: Request) {
        let slot = match Process::from_code(request.controller) {
            Some(Process::Controller) => 0,
            Some(Process::Standby) => 1,
            _ => {
                self.rejections.count += 1;
                self.rejections.stray = Some(ValidationError::Code { field: "controller", found: request.controller });
                return;
            }
        };
        let due = if self.follows { self.start.gates.published() + 1 } else { self.gate.tick() };
        let newest = self.received.requests[slot].newest().map_or(i64::MIN, |r| r.tick);
        let again = request.tick < due && request.tick <= newest;
        let far = again || request.tick.abs_diff(due) > NEAR as u64;
        if far && self.follows {
            // Of a tick that the other gate has done.
            return;
        }
        if far {
            self.rejections.count += 1;
            self.rejections.slots[slot] =
                Some(ValidationError::Tick { field: "tick", found: request.tick, expected: due.max(newest + 1) });
            return;
        }
        self.received.requests[slot].insert(request);
    }

    fn validate_state(&self, state: &State) -> Result<(), ValidationError> {
        state.check()?;
        let expected = self.received.newest.map_or(0, |(tick, _)| tick + 1);
        // The plant does tick after tick; a delayed gate may have missed as many as there has been time for.
        let missed = match (self.start.clock, self.received.newest) {
            // While the other gate works, this one receives now and then: as far as that has come, and a little further.
            _ if self.follows => self.start.gates.published() + NEAR - expected,
            (Clock::Realtime, Some((_, stamp))) => (clock::now_ns().saturating_sub(stamp) / PERIOD_NS) as i64 + NEAR,
            _ => 0,
        };
        if (expected..=expected + missed).contains(&state.tick) && state.tick < self.start.ticks {
            return Ok(());
        }
        Err(ValidationError::Tick { field: "tick", found: state.tick, expected })
    }

    /// Observes which controllers have answered the tick that is due. A request without its state does not count yet.
    pub(super) fn observe(&mut self, overdue: bool) -> (Observation, [Option<Request>; CONTROLLERS]) {
        let tick = self.gate.tick();
        let present = self.start.shared.presence.present.load(Ordering::Acquire);
        let mut seen = Observation { overdue, ..Observation::default() };
        let mut requests = [None; CONTROLLERS];
        let state = self.received.states.at(tick);
        for slot in ControllerSlot::BOTH {
            let i = slot as usize;
            seen.present[i] = present & (1 << slot.process().code()) != 0;
            let (Some(state), Some(request)) = (state, self.received.requests[i].at(tick)) else { continue };
            match self.gate.validate(request, state, self.start.schedule.operator().at(tick)) {
                Ok(()) => {
                    seen.valid[i] = true;
                    requests[i] = Some(*request);
                }
                Err(defect) => {
                    seen.rejected[i] = true;
                    // Validated again at every wake-up of this tick, reported once.
                    if self.rejections.slots[i].is_none() {
                        self.rejections.count += 1;
                        self.rejections.slots[i] = Some(defect);
                    }
                }
            }
        }
        (seen, requests)
    }
}
