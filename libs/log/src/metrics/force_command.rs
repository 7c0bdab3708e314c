//! Metrics of F_c against F_max.

use super::sample::{CommandSample, ParameterSample};
use super::summary::ForceCommandSummary;
use super::tracking::AT_LIMIT;

/// Sums over the commands in mode `active`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ForceCommandSums {
    axes: [ForceCommandAxisSums; 3],
    active: u64,
    above_limit: u64,
}

/// Sums of an axis.
#[derive(Clone, Copy, Debug, Default)]
struct ForceCommandAxisSums {
    largest: f64,
    limit: f64,
    ratio: f64,
    at_limit: u64,
}

impl ForceCommandSums {
    pub(super) fn tick(&mut self, command: &CommandSample, set: &ParameterSample) {
        self.active += 1;
        let mut above = false;
        for (i, axis) in self.axes.iter_mut().enumerate() {
            let force = command.force[i].abs();
            let limit = set.max_force[i];
            axis.largest = axis.largest.max(force);
            axis.limit = axis.limit.max(limit);
            above |= force > limit;
            if limit > 0.0 {
                axis.ratio = axis.ratio.max(force / limit);
                axis.at_limit += u64::from(force >= AT_LIMIT * limit);
            }
        }
        self.above_limit += u64::from(above);
    }

    pub(super) fn summary(&self) -> ForceCommandSummary {
        ForceCommandSummary {
            max_n: self.axes.map(|axis| axis.largest),
            limit_n: self.axes.map(|axis| axis.limit),
            max_ratio: self.axes.map(|axis| axis.ratio),
            active_ticks: self.active,
            at_limit_ticks: self.axes.map(|axis| axis.at_limit),
            above_limit_ticks: self.above_limit,
        }
    }
}
