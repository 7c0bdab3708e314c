//! Limits that the gate enforces.

use hapfic_config::{PERIOD_S, Settings};
use hapfic_messages::MAX_JOINTS;
use hapfic_robot::Chain;

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
    /// Most that a joint's torque may change in a second while ramping in after a brake, N m/s.
    pub ramp_rate: f64,
    /// TorqueStep of a joint's torque from one tick to the next that is told of, N m.
    pub discontinuity: f64,
}

impl Limits {
    /// Limits of a scenario and its robot: the peak is the scenario's, else the effort limit of each joint.
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
            period_s: PERIOD_S,
            ramp_rate: settings.supervisor.ramp_rate,
            discontinuity: settings.supervisor.discontinuity,
        }
    }
}
