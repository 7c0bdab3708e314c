//! Limits that the gate enforces.

use hapfic_config::{PERIOD_S, Settings, TorqueSaturation};
use hapfic_messages::MAX_JOINTS;
use hapfic_robot::Chain;

/// Limits that the gate enforces on a robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GateLimits {
    /// Number of joints of the robot.
    pub joints: usize,
    /// Bandwidth of the torque filter [Hz]; `None`: no filter.
    pub bandwidth_hz: Option<f64>,
    /// Peak of each joint's torque [N m].
    pub peak: [f64; MAX_JOINTS],
    /// Treatment of a torque beyond its peak.
    pub saturation: TorqueSaturation,
    /// Length of a tick [s].
    pub period_s: f64,
    /// Largest rate of a joint's torque while it ramps in after a brake [N m/s].
    pub ramp_rate: f64,
    /// Largest rate of a joint's torque at any time [N m/s]; `None`: no limit.
    pub torque_rate: Option<f64>,
    /// Step of a joint's torque from one tick to the next above which the gate reports it [N m].
    pub discontinuity: f64,
}

impl GateLimits {
    /// Limits of a scenario and its robot. The peak is the scenario's, or else the effort limit of each joint.
    #[must_use]
    pub fn new(settings: &Settings, chain: &Chain) -> Self {
        let joints = chain.joints();
        let mut peak = [0.0; MAX_JOINTS];
        for (i, joint) in joints.iter().enumerate() {
            peak[i] = settings.supervisor.torque_peak.as_ref().map_or(joint.effort, |list| list[i]);
        }
        Self {
            joints: joints.len(),
            bandwidth_hz: settings.supervisor.torque_bandwidth_hz,
            peak,
            saturation: settings.supervisor.torque_saturation,
            period_s: PERIOD_S,
            ramp_rate: settings.supervisor.ramp_rate,
            torque_rate: settings.supervisor.torque_rate,
            discontinuity: settings.supervisor.discontinuity,
        }
    }
}
