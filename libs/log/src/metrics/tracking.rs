//! Metrics of the error x - x_d, and the causes of large errors.

use super::sample::{CommandSample, ParameterSample, ReferenceSample, StateSample};
use super::sum::Sum;
use super::summary::{OrientationSummary, OutsideSummary, TrackingSummary};

/// Share of F_max from which F_c counts as at its limit: the profile approaches it up to a small step at the end.
pub(super) const AT_LIMIT: f64 = 0.999;

/// Speed against the reference below which an axis is at rest [m/s].
const REST_M_PER_S: f64 = 1e-3;

/// Sums over the ticks with a state and a reference.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TrackingSums {
    axes: [TrackingAxisSums; 3],
    outside: u64,
    turned: Sum,
    turned_last: f64,
}

/// Sums of an axis.
#[derive(Clone, Copy, Debug, Default)]
struct TrackingAxisSums {
    error: Sum,
    ratio: Sum,
    bound: f64,
    outside: u64,
    force_limited: u64,
    torque_limited: u64,
    force_held: u64,
    converging: u64,
    at_rest: u64,
    inactive: u64,
    unexplained: u64,
}

impl TrackingSums {
    pub(super) fn tick(
        &mut self,
        state: &StateSample,
        reference: &ReferenceSample,
        command: Option<&CommandSample>,
        set: Option<&ParameterSample>,
    ) {
        if let Some(turned) = command.filter(|command| command.active).and_then(|command| command.turned) {
            self.turned.add(turned);
            self.turned_last = turned;
        }
        let mut outside = false;
        for (i, axis) in self.axes.iter_mut().enumerate() {
            let error = state.position[i] - reference.position[i];
            axis.error.add(error);
            let Some(set) = set else { continue };
            let bound = set.position_bound[i];
            axis.bound = axis.bound.max(bound);
            if bound > 0.0 {
                axis.ratio.add(error / bound);
            }
            if error.abs() > bound {
                outside = true;
                axis.outside += 1;
                *axis.cause(i, state, command, set) += 1;
                let at_rest = (state.velocity[i] - reference.velocity[i]).abs() < REST_M_PER_S;
                axis.at_rest += u64::from(at_rest && command.is_some_and(|command| command.active && command.converging[i]));
            }
        }
        self.outside += u64::from(outside);
    }

    pub(super) fn summary(&self) -> TrackingSummary {
        TrackingSummary {
            max_m: self.axes.map(|axis| axis.error.largest),
            rms_m: self.axes.map(|axis| axis.error.rms().unwrap_or(0.0)),
            bound_m: self.axes.map(|axis| axis.bound),
            max_ratio: self.axes.map(|axis| axis.ratio.largest),
            rms_ratio: self.axes.map(|axis| axis.ratio.rms().unwrap_or(0.0)),
            outside_ticks: self.outside,
            orientation: self.turned.rms().map(|rms_rad| OrientationSummary {
                max_rad: self.turned.largest,
                rms_rad,
                last_rad: self.turned_last,
            }),
            outside: OutsideSummary {
                ticks: self.axes.map(|axis| axis.outside),
                force_limited_ticks: self.axes.map(|axis| axis.force_limited),
                torque_limited_ticks: self.axes.map(|axis| axis.torque_limited),
                force_held_ticks: self.axes.map(|axis| axis.force_held),
                converging_ticks: self.axes.map(|axis| axis.converging),
                standing_ticks: self.axes.map(|axis| axis.at_rest),
                inactive_ticks: self.axes.map(|axis| axis.inactive),
                unexplained_ticks: self.axes.map(|axis| axis.unexplained),
            },
        }
    }
}

impl TrackingAxisSums {
    /// Selects the counter for an error beyond x_b: that of the first cause that applies.
    fn cause(&mut self, i: usize, state: &StateSample, command: Option<&CommandSample>, set: &ParameterSample) -> &mut u64 {
        let Some(command) = command.filter(|command| command.active) else { return &mut self.inactive };
        if command.force[i].abs() >= AT_LIMIT * set.largest_force(i) {
            &mut self.force_limited
        } else if command.limited {
            &mut self.torque_limited
        } else if set.desired_force[i] != 0.0 && state.force[i].abs() > set.force_resolution {
            // The offset compensates the distance: here the law holds a force, not a position. Contact without a
            // desired force is no cause: there F_c can rise to F_max.
            &mut self.force_held
        } else if command.converging[i] || set.continuous_reentry {
            // In convergence the law gives less than its profile: 2 F_c(x_max) / x_max (e - x_max / 2). With continuous
            // re-entry the force rises from there, also in divergence.
            &mut self.converging
        } else {
            &mut self.unexplained
        }
    }
}
