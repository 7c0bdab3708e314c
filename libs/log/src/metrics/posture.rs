//! Joints near zero, and axes with a desired force without contact.

use super::label::FixedList;
use super::moments::{AirSummary, JointSummary};
use super::sample::{CommandSample, ParameterSample};
use hapfic_messages::MAX_JOINTS;

/// Angle below which a joint is straight [rad]: one degree.
const STRAIGHT_RAD: f64 = std::f64::consts::PI / 180.0;

/// The joints, from the base to the tip.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct JointSums {
    smallest: [Option<f64>; MAX_JOINTS],
    straight: [u64; MAX_JOINTS],
}

impl JointSums {
    pub(super) fn tick(&mut self, positions: &[f64]) {
        for ((position, smallest), straight) in positions.iter().zip(&mut self.smallest).zip(&mut self.straight) {
            let size = position.abs();
            *smallest = Some(smallest.map_or(size, |least| least.min(size)));
            *straight += u64::from(size <= STRAIGHT_RAD);
        }
    }

    pub(super) fn summary(&self) -> FixedList<JointSummary, MAX_JOINTS> {
        let joints = self.smallest.iter().zip(self.straight);
        joints
            .filter_map(|(smallest, straight_ticks)| {
                smallest.map(|rad| JointSummary { smallest_deg: rad.to_degrees(), straight_ticks })
            })
            .collect()
    }
}

/// Axes with a desired force while the foot touches nothing.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct AirSums {
    summary: AirSummary,
}

impl AirSums {
    /// Adds a tick with an active command and no contact of the foot.
    pub(super) fn tick(&mut self, command: &CommandSample, set: &ParameterSample) {
        let (Some(offset), Some(error)) = (command.offset, command.error) else { return };
        let sum = &mut self.summary;
        for i in (0..3).filter(|&i| set.desired_force[i] != 0.0) {
            sum.ticks[i] += 1;
            sum.max_offset_m[i] = sum.max_offset_m[i].max(offset[i].abs());
            sum.max_error_m[i] = sum.max_error_m[i].max(error[i].abs());
        }
    }

    pub(super) fn summary(&self) -> AirSummary {
        self.summary
    }
}
