//! Torque conditioning: bandwidth and peak of the actuators, applied to a raw torque (fourth experiment).

use core::f64::consts::TAU;
use hapfic_messages::MAX_JOINTS;

/// First-order low-pass of the joint torques, discretised exactly: `alpha = 1 - exp(-2 pi f T)`.
///
/// The peak ([`limit`]) acts on the output, not on the state of the filter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LowPass {
    /// Filtered torque [N m]. Starts at 0.
    pub output: [f64; MAX_JOINTS],
}

impl LowPass {
    /// Runs one control tick of `period_s` [s] with the raw torque [N m] and the cut-off frequency [Hz].
    ///
    /// Without a cut-off (`None`) the torque passes and the state follows it, so that a filter that starts later starts
    /// from it. A cut-off or period that is not a positive number counts as none. A torque that is not finite counts as
    /// zero.
    #[must_use]
    pub fn step(self, input: &[f64; MAX_JOINTS], cutoff_hz: Option<f64>, period_s: f64) -> Self {
        let exponent = cutoff_hz.map_or(f64::INFINITY, |frequency| TAU * frequency * period_s);
        let alpha = if exponent > 0.0 { -(-exponent).exp_m1() } else { 1.0 };
        let mut output = self.output;
        for (filtered, raw) in output.iter_mut().zip(input) {
            // Weights instead of a difference: the weighted sum of two finite torques cannot overflow.
            *filtered = (1.0 - alpha) * finite(*filtered) + alpha * finite(*raw);
        }
        Self { output }
    }
}

/// Limits each torque to +-its peak [N m; N for a prismatic joint]; also returns the limited joints: bit i for joint i.
///
/// An infinite peak does not limit. A torque that is not finite becomes zero and counts as limited. A peak that is
/// negative or nan limits the torque to zero.
#[must_use]
pub fn limit(torque: &[f64; MAX_JOINTS], peak: &[f64; MAX_JOINTS]) -> ([f64; MAX_JOINTS], u32) {
    let mut limited = 0_u32;
    let mut output = [0.0; MAX_JOINTS];
    for (joint, ((output, torque), peak)) in output.iter_mut().zip(torque).zip(peak).enumerate() {
        let peak = peak.max(0.0);
        *output = finite(*torque).clamp(-peak, peak);
        if *output != *torque {
            limited |= 1_u32 << joint;
        }
    }
    (output, limited)
}

fn finite(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}
