//! Conditioning of a requested torque: filter, rate and peak.
//!
//! Two invariants hold at every active tick, for any requests before it: no joint's torque exceeds its peak, and with a
//! rate limit none differs from the last published torque by more than rate times period (both up to rounding).
//!
//! The order depends on [`TorqueSaturation`], since both must hold at once:
//!
//! - `clip`: filter, rate, peak. Joints are independent. The last torque is within the peak, so that a clipped torque is
//!   nearer to it than one that is not: the rate still holds.
//! - `scale`: filter, peak, rate. Scaling after the rate could move another joint by more than its rate. The rate scales
//!   the steps of all joints together, so the torque goes straight from the last one to the desired one; between two
//!   torques within the peaks every torque is within them. From rest the direction is the desired one from the first tick.
//!
//! Neither limit acts on the state of the filter, which follows the requests alone.

use crate::limits::GateLimits;
use hapfic_config::TorqueSaturation;
use hapfic_controller::torque_filter::{LowPass, limit};
use hapfic_messages::MAX_JOINTS;

/// Conditioned torque of a tick, and the limits that acted on it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ConditionedTorque {
    /// Torque [N m; N for a prismatic joint].
    pub torque: [f64; MAX_JOINTS],
    /// Bit i: joint i was beyond its peak.
    pub limited: u32,
    /// Bit i: joint i was beyond the rate of the ramp after a brake.
    pub ramped: u32,
    /// Bit i: joint i was beyond the rate limit of normal operation.
    pub rate_limited: u32,
}

/// State of the conditioning from tick to tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Conditioning {
    filter: LowPass,
    /// Whether the torque ramps in after a brake.
    ramping: bool,
}

/// Largest step of a joint's torque in a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LargestStep {
    /// Size [N m; N for a prismatic joint].
    size: f64,
    /// Whether the ramp after a brake gives it, not the rate limit of normal operation.
    ramp: bool,
}

impl Conditioning {
    /// State after a brake: filter cleared, the torque ramps in.
    #[must_use]
    pub fn after_brake() -> Self {
        Self { filter: LowPass::default(), ramping: true }
    }

    /// State as a command carries it: output of the filter [N m; N], and whether the torque ramps in.
    #[must_use]
    pub fn carried(&self) -> ([f64; MAX_JOINTS], bool) {
        (self.filter.output, self.ramping)
    }

    /// State from what a command carries.
    #[must_use]
    pub fn from_carried(output: [f64; MAX_JOINTS], ramping: bool) -> Self {
        Self { filter: LowPass { output }, ramping }
    }

    /// Conditions the requested torque of a tick, given the last published one [N m; N for a prismatic joint].
    #[must_use]
    pub fn step(self, requested: &[f64; MAX_JOINTS], last: &[f64; MAX_JOINTS], limits: &GateLimits) -> (Self, ConditionedTorque) {
        let filter = self.filter.step(requested, limits.bandwidth_hz, limits.period_s);
        let most = self.largest_step(limits);
        let (torque, limited, slowed) = match limits.saturation {
            TorqueSaturation::Clip => {
                let (slow, slowed) = slow_each(filter.output, last, most, limits.joints);
                let (torque, limited) = limit(&slow, &limits.peak);
                (torque, limited, slowed)
            }
            TorqueSaturation::Scale => {
                let (scaled, limited) = scale(&filter.output, limits);
                let (slow, slowed) = slow_together(scaled, last, most, limits.joints);
                // Rounding must not exceed a peak.
                (limit(&slow, &limits.peak).0, limited, slowed)
            }
        };
        let ramp = most.is_some_and(|most| most.ramp);
        // The ramp ends once every joint has its desired torque.
        let next = Self { filter, ramping: self.ramping && slowed != 0 };
        // At its peak a clipped joint has all the torque it may have, whatever its rate.
        let short = if limits.saturation == TorqueSaturation::Clip { slowed & !limited } else { slowed };
        let [ramped, rate_limited] = if ramp { [slowed, 0] } else { [0, short] };
        (next, ConditionedTorque { torque, limited, ramped, rate_limited })
    }

    /// The smaller of the two rates that apply, as a step.
    fn largest_step(self, limits: &GateLimits) -> Option<LargestStep> {
        let step = |rate: f64, ramp| LargestStep { size: rate * limits.period_s, ramp };
        match (self.ramping, limits.torque_rate) {
            (false, None) => None,
            (true, Some(rate)) if rate < limits.ramp_rate => Some(step(rate, false)),
            (true, _) => Some(step(limits.ramp_rate, true)),
            (false, Some(rate)) => Some(step(rate, false)),
        }
    }
}

/// Limits the step of each joint; also returns the joints that were beyond it.
fn slow_each(
    mut torque: [f64; MAX_JOINTS],
    last: &[f64; MAX_JOINTS],
    most: Option<LargestStep>,
    joints: usize,
) -> ([f64; MAX_JOINTS], u32) {
    let Some(LargestStep { size, .. }) = most else { return (torque, 0) };
    let mut slowed = 0;
    for (i, (torque, last)) in torque.iter_mut().zip(last).enumerate().take(joints) {
        let step = *torque - last;
        if step.abs() > size {
            *torque = last + size.copysign(step);
            slowed |= 1 << i;
        }
    }
    (torque, slowed)
}

/// Scales the steps of all joints together until none is too large; also returns the joints that were beyond the limit.
fn slow_together(
    mut torque: [f64; MAX_JOINTS],
    last: &[f64; MAX_JOINTS],
    most: Option<LargestStep>,
    joints: usize,
) -> ([f64; MAX_JOINTS], u32) {
    let Some(LargestStep { size, .. }) = most else { return (torque, 0) };
    let (mut slowed, mut largest) = (0, size);
    for (i, (torque, last)) in torque.iter().zip(last).enumerate().take(joints) {
        let step = (torque - last).abs();
        if step > size {
            slowed |= 1 << i;
            largest = step.max(largest);
        }
    }
    if slowed != 0 {
        for (torque, last) in torque.iter_mut().zip(last).take(joints) {
            // The share of a step in the largest one is at most 1, so the product cannot exceed the limit.
            *torque = last + (*torque - last) / largest * size;
        }
    }
    (torque, slowed)
}

/// Scales the torques of all joints together by the smallest peak / |torque|, so that their direction stays; also returns
/// the joints that were beyond their peak.
///
/// A peak that is negative or nan counts as zero, as in [`limit`]. Entries beyond the joints become zero.
fn scale(torque: &[f64; MAX_JOINTS], limits: &GateLimits) -> ([f64; MAX_JOINTS], u32) {
    let mut output = [0.0; MAX_JOINTS];
    let mut limited = 0;
    // Peak and |torque| of the joint with the smallest ratio.
    let mut worst: Option<(f64, f64)> = None;
    for (i, (torque, peak)) in torque.iter().zip(&limits.peak).enumerate().take(limits.joints) {
        let (size, peak) = (torque.abs(), peak.max(0.0));
        if size > peak {
            limited |= 1 << i;
            if worst.is_none_or(|(other_peak, other)| peak / size < other_peak / other) {
                worst = Some((peak, size));
            }
        }
    }
    for (output, torque) in output.iter_mut().zip(torque).take(limits.joints) {
        *output = worst.map_or(*torque, |(peak, size)| torque / size * peak);
    }
    (limit(&output, &limits.peak).0, limited)
}
