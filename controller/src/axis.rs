//! The task-space law on one axis: search, attractor, damping and the improvements around them.

use crate::adaptive_taper::AdaptiveTaper;
use crate::anti_windup::{bumpless_offset, conditional_integration};
use crate::attractor::{Attractor, ContinuousAttractor};
use crate::damping::damped;
use crate::force_hold::{self, Contact};
use crate::haptic::{HapticParameters, HapticSearch};
use crate::profile::ForceProfile;
use crate::stall_release::{Stall, StallInput};
use crate::task_space::Policies;
use hapfic_messages::{ControllerState, Parameters, Search};

/// State of the law on one axis; fields as in [`ControllerState`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct AxisState {
    offset: f64,
    /// K0 [N/m], F_max [N] and x_b [m] of the tick before.
    gains: [f64; 3],
    force: f64,
    attractor: AttractorState,
    search: AdaptiveTaper,
    stall: Stall,
    free_s: f64,
}

impl AxisState {
    pub(crate) fn read(state: &ControllerState, axis: usize) -> Self {
        Self {
            offset: state.offset[axis],
            gains: [state.stiffness[axis], state.max_force[axis], state.position_bound[axis]],
            force: state.force[axis],
            attractor: AttractorState {
                x_max_m: state.x_max[axis],
                x_max_force: state.x_max_force[axis],
                converging: state.converging[axis] != 0,
            },
            search: AdaptiveTaper {
                taper: state.taper[axis],
                force_error: state.force_error[axis],
                slow_error: state.slow_error[axis],
            },
            stall: Stall { at_rest_ticks: state.at_rest_ticks[axis] },
            free_s: state.free_time[axis],
        }
    }

    pub(crate) fn write(&self, state: &mut ControllerState, axis: usize) {
        state.offset[axis] = self.offset;
        [state.stiffness[axis], state.max_force[axis], state.position_bound[axis]] = self.gains;
        state.force[axis] = self.force;
        state.x_max[axis] = self.attractor.x_max_m;
        state.x_max_force[axis] = self.attractor.x_max_force;
        state.converging[axis] = u32::from(self.attractor.converging);
        state.taper[axis] = self.search.taper;
        state.force_error[axis] = self.search.force_error;
        state.slow_error[axis] = self.search.slow_error;
        state.at_rest_ticks[axis] = self.stall.at_rest_ticks;
        state.free_time[axis] = self.free_s;
    }
}

/// State of either attractor.
type AttractorState = ContinuousAttractor;

/// Inputs of an axis in one tick, as in [`TaskSpaceInput`](crate::task_space::TaskSpaceInput).
#[derive(Clone, Copy, Debug)]
pub(crate) struct AxisInput {
    /// x_d - x [m].
    pub(crate) distance: f64,
    pub(crate) reference: f64,
    pub(crate) position: f64,
    pub(crate) reference_velocity: f64,
    pub(crate) velocity: f64,
    pub(crate) measured: f64,
}

/// Outputs of an axis in one tick, as in [`TaskSpaceOutput`](crate::task_space::TaskSpaceOutput).
#[derive(Clone, Copy, Debug)]
pub(crate) struct AxisOutput {
    pub(crate) state: AxisState,
    pub(crate) error: f64,
    pub(crate) error_rate: f64,
    pub(crate) force: f64,
}

/// The law on one axis under a set of parameters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AxisLaw {
    policies: Policies,
    profile: ForceProfile,
    haptic: HapticParameters,
    desired: f64,
    damping: f64,
}

impl AxisLaw {
    pub(crate) fn new(p: &Parameters, policies: &Policies, axis: usize, period_s: f64) -> Self {
        Self {
            policies: *policies,
            profile: ForceProfile {
                stiffness: p.stiffness[axis],
                max_force: p.max_force[axis],
                position_bound: p.position_bound[axis],
                saturation: policies.saturation,
            },
            haptic: HapticParameters {
                stiffness: p.stiffness[axis],
                position_bound: p.position_bound[axis],
                search: policies.search,
                reset_policy: policies.reset_policy,
                taper: p.taper,
                search_scale: p.search_scale,
                force_resolution: p.force_resolution,
                period_s,
            },
            desired: p.desired_force[axis],
            damping: p.damping,
        }
    }

    /// Runs one control tick. The numbers of state and input are finite.
    pub(crate) fn step(&self, before: AxisState, input: &AxisInput) -> AxisOutput {
        let error_at = |offset: f64| input.reference + offset - input.position;
        let force_error = self.desired - input.measured;
        // In contact under a desired force the force decides on this axis, otherwise the position.
        let engaged = self.desired != 0.0 && input.measured.abs() > self.haptic.force_resolution;
        let free = input.measured.abs() <= self.haptic.force_resolution;
        let jump = if free { 0.0 } else { f64::INFINITY };
        let mut attractor = before.attractor;
        let mut error_rate = input.reference_velocity - input.velocity;
        let bound = self.haptic.position_bound.max(0.0);
        // What is held counts from the offset that the bound of this tick leaves.
        let mut held = if self.policies.force_hold { before.offset.clamp(-bound, bound) } else { before.offset };
        if self.policies.force_hold && engaged {
            let followed = force_hold::follow(held, input.reference_velocity, bound, self.haptic.period_s);
            error_rate += (followed - held) / self.haptic.period_s;
            held = followed;
        }
        let changed = engaged && self.changed(&before);
        if changed {
            let (_, unchanged) = self.attract(attractor, error_at(held), error_rate, f64::INFINITY);
            if let Some(offset) = self.refit(input, before.force, unchanged) {
                held = offset;
                // A convergence restarts from here: at its start the force is the profile's.
                attractor = AttractorState::default();
            }
        }
        let free_s = force_hold::free_time(before.free_s, free, self.haptic.period_s);
        let bounces = self.policies.force_hold && self.desired != 0.0 && force_hold::bounces(free_s);
        let mut search = if bounces { before.search } else { AdaptiveTaper::default() };
        let mut haptic = self.haptic;
        if haptic.search == Search::Adaptive && engaged {
            search = before.search.step(self.desired, force_error, haptic.force_resolution, haptic.taper, haptic.period_s);
            haptic.taper = search.taper;
        }
        // The reaction of the tick of a change is still that of the old gains: the search would add to the change.
        let mut proposed = if changed && self.policies.force_hold {
            held
        } else {
            HapticSearch { offset_m: held }.step(self.desired, input.measured, &haptic).offset_m
        };
        if self.policies.force_hold && !engaged && proposed == 0.0 {
            proposed = if bounces { held } else { force_hold::returned(held, haptic.period_s) };
        }
        // Only a step away from zero can wind up.
        let offset = if self.policies.offset_anti_windup && proposed.abs() > held.abs() {
            let (_, force) = self.attract(attractor, error_at(held), error_rate, jump);
            conditional_integration(held, proposed, force, self.profile.largest())
        } else {
            proposed
        };
        let mut offset = offset;
        let mut error = error_at(offset);
        let (mut attractor, mut force) = self.attract(attractor, error, error_rate, jump);
        let mut stall = Stall::default();
        if self.policies.stall_release {
            let stall_input = StallInput {
                error,
                error_rate,
                force,
                contact_force: input.measured,
                force_resolution: haptic.force_resolution,
                period_s: haptic.period_s,
            };
            (stall, attractor, force) = self.release(before.stall, attractor, &stall_input);
        }
        if self.policies.force_hold && engaged && attractor.converging && Stall::is_at_rest(error_rate) {
            stall = Stall { at_rest_ticks: before.stall.at_rest_ticks.saturating_add(1) };
            let latched = self.profile.error_for(force) - input.distance;
            if stall.is_long(self.haptic.period_s) && latched.abs() <= self.haptic.position_bound {
                // The search has made up for a convergence that came to rest: the force stays, its past does not.
                offset = latched;
                error = error_at(offset);
                stall = Stall::default();
                attractor = AttractorState { x_max_m: error, x_max_force: force, converging: true };
            }
        }
        let state = AxisState {
            offset,
            // Stored always, so that no law compares with outdated gains after it is switched on.
            gains: [self.profile.stiffness, self.profile.max_force, self.profile.position_bound],
            force,
            attractor,
            search,
            stall,
            free_s,
        };
        let force = damped(force, error_rate, self.damping, self.profile.stiffness, self.profile.max_force.max(0.0));
        AxisOutput { state, error, error_rate, force }
    }

    /// Whether K0, F_max or x_b differ from the tick before. A stiffness of zero: there was none.
    fn changed(&self, before: &AxisState) -> bool {
        let now = [self.profile.stiffness, self.profile.max_force, self.profile.position_bound];
        before.gains[0] > 0.0 && before.gains != now
    }

    /// Returns the offset for new gains in contact [m]; `None` if the present one stays.
    ///
    /// `before` is the attractor's force in the tick before [N], `unchanged` the one under the new gains.
    fn refit(&self, input: &AxisInput, before: f64, unchanged: f64) -> Option<f64> {
        let contact = Contact { desired: self.desired, measured: input.measured, before, unchanged };
        if self.policies.force_hold {
            return contact.refit(input.distance, &self.profile);
        }
        // Predicted reaction with an unchanged dx: the wall balances the change of F_c.
        let predicted = input.measured - (unchanged - before);
        let nearer = (self.desired - input.measured).abs() <= (self.desired - predicted).abs();
        (self.policies.offset_anti_windup && nearer).then(|| bumpless_offset(input.distance, before, &self.profile))
    }

    fn attract(&self, attractor: AttractorState, error: f64, error_rate: f64, jump: f64) -> (AttractorState, f64) {
        if self.policies.continuous_reentry {
            return attractor.step(error, error_rate, jump, &self.profile);
        }
        let printed = Attractor { x_max_m: attractor.x_max_m, converging: attractor.converging };
        let (next, force) = printed.step(error, error_rate, &self.profile);
        (AttractorState { x_max_m: next.x_max_m, converging: next.converging, x_max_force: 0.0 }, force)
    }

    fn release(&self, stall: Stall, attractor: AttractorState, input: &StallInput) -> (Stall, AttractorState, f64) {
        let printed = Attractor { x_max_m: attractor.x_max_m, converging: attractor.converging };
        let (stall, next, force) = stall.step(printed, input, &self.profile);
        let x_max_force = if next == printed || !self.policies.continuous_reentry { attractor.x_max_force } else { force };
        (stall, AttractorState { x_max_m: next.x_max_m, converging: next.converging, x_max_force }, force)
    }
}
