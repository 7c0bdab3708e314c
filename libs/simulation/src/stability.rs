//! Stability check: whether a set of gains holds the limb in free air without oscillation, at the dead time of the
//! loop.
//!
//! The law is passive, but a torque that acts a tick late is not. At the gains of the paper, the leg settles with one
//! tick of dead time and oscillates with two. It also oscillates behind a slow torque filter without joint damping, and
//! behind a low limit of the torque's rate. The numbers of a scenario do not show this, so the check simulates the stack at
//! the start posture.

use crate::{DeadTime, Simulation, SimulationError};
use hapfic_config::{ParameterSettings, Settings};
use hapfic_messages::MAX_JOINTS;

/// Duration of the test [s].
pub(crate) const TEST_S: u32 = 3;
/// Final part in which the limb must be at rest [ticks].
const OBSERVED_TICKS: u32 = 500;
/// Disturbance: speed added to each joint, of alternating sign [rad/s], [m/s] for a prismatic joint.
const KICK: f64 = 0.05;
/// Tick of the disturbance; the brakes, which would cancel it, are off by then under every dead time.
const KICK_TICK: u32 = 2;
/// Largest motion of the foot at rest [m]: settling tails and creep are below, oscillations above.
pub(crate) const REST_AMPLITUDE_M: f64 = 2e-4;
/// Largest joint speed at rest [rad/s], [m/s] for a prismatic joint.
const REST_SPEED_RAD_PER_S: f64 = 0.02;

/// Result of a stability check.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StabilityResult {
    /// Whether the limb came to rest.
    pub settles: bool,
    /// Largest peak-to-peak motion of the foot on an axis at the end [m]. Infinite if the motion left the finite
    /// numbers.
    pub amplitude_m: f64,
    /// Largest joint speed at the end [rad/s], [m/s] for a prismatic joint. Infinite as above.
    pub joint_speed: f64,
    /// Whether the midpoint of the foot's motion at the end is within x_b of its start.
    pub within_bound: bool,
}

/// Checks whether a disturbed limb comes to rest in free air at its start posture under a set of parameters.
///
/// The check takes a fraction of a second. Floor and objects are left out. Gravity, joint damping, torque filter,
/// rate limit and peak are the scenario's. The reference rests at the start position of the foot, and F_d is zero.
///
/// # Errors
/// [`SimulationError::Plant`] if the limb cannot be simulated at all. Divergence is a result, not an error.
pub fn settles(settings: &Settings, gains: &ParameterSettings, dead_time: DeadTime) -> Result<StabilityResult, SimulationError> {
    let settled = settles_within(settings, gains, dead_time, TEST_S, &|| true)?;
    Ok(settled.unwrap_or(DIVERGED))
}

/// As [`settles`], in a test of so many seconds; `None` if `proceed`, asked each tick, has ended it.
pub(crate) fn settles_within(
    settings: &Settings,
    gains: &ParameterSettings,
    dead_time: DeadTime,
    seconds: u32,
    proceed: &dyn Fn() -> bool,
) -> Result<Option<StabilityResult>, SimulationError> {
    let mut free = settings.clone();
    free.world.floor = None;
    free.world.objects.clear();
    free.operator.clear();
    free.initial = ParameterSettings { target_position: None, desired_force: [0.0; 3], ..*gains };
    let mut simulation = Simulation::with_dead_time(&free, dead_time)?;
    Ok(kick_and_observe(&mut simulation, &gains.position_bound, 1000 * seconds, proceed).unwrap_or(Some(DIVERGED)))
}

/// Result of a motion that left the finite numbers.
const DIVERGED: StabilityResult =
    StabilityResult { settles: false, amplitude_m: f64::INFINITY, joint_speed: f64::INFINITY, within_bound: true };

/// Whether two sets make the same loop in free air with F_d = 0.
pub(crate) fn same_loop(a: &ParameterSettings, b: &ParameterSettings) -> bool {
    let gains = |p: &ParameterSettings| (p.stiffness, p.max_force, p.position_bound);
    let rules = |p: &ParameterSettings| (p.saturation, p.gravity_compensation, p.stall_release, p.continuous_reentry);
    let damping = |p: &ParameterSettings| (p.damping, p.posture_lead);
    gains(a) == gains(b) && rules(a) == rules(b) && damping(a) == damping(b)
}

fn kick_and_observe(
    simulation: &mut Simulation,
    bound: &[f64; 3],
    ticks: u32,
    proceed: &dyn Fn() -> bool,
) -> Result<Option<StabilityResult>, SimulationError> {
    let (mut lowest, mut highest) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    let mut joint_speed = 0.0_f64;
    let mut start = [0.0; 3];
    for tick in 0..ticks {
        if !proceed() {
            return Ok(None);
        }
        let state = simulation.step()?.state;
        if tick == 0 {
            start = state.foot_position;
        }
        if tick >= ticks - OBSERVED_TICKS {
            for axis in 0..3 {
                lowest[axis] = lowest[axis].min(state.foot_position[axis]);
                highest[axis] = highest[axis].max(state.foot_position[axis]);
            }
            joint_speed = state.joint_velocity.iter().fold(joint_speed, |most, speed| most.max(speed.abs()));
        }
        if tick == KICK_TICK {
            let joints = state.joints as usize;
            let mut kick = [0.0; MAX_JOINTS];
            for (joint, change) in kick[..joints].iter_mut().enumerate() {
                *change = if joint % 2 == 0 { KICK } else { -KICK };
            }
            simulation.plant().kick(&kick);
        }
    }
    let amplitude_m = (0..3).map(|axis| highest[axis] - lowest[axis]).fold(0.0, f64::max);
    let within_bound = (0..3).all(|axis| (0.5 * (lowest[axis] + highest[axis]) - start[axis]).abs() <= bound[axis]);
    Ok(Some(StabilityResult {
        settles: amplitude_m <= REST_AMPLITUDE_M && joint_speed <= REST_SPEED_RAD_PER_S,
        amplitude_m,
        joint_speed,
        within_bound,
    }))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn verdict(overrides: &[&str], dead_time: DeadTime) -> StabilityResult {
        let overrides: Vec<String> = overrides.iter().map(|argument| (*argument).to_owned()).collect();
        let settings = Settings::load("floor", &overrides).unwrap();
        settles(&settings, &settings.initial, dead_time).unwrap()
    }

    #[test]
    fn gains_of_paper_settle_up_to_one_tick_dead_time() {
        for dead_time in [DeadTime::None, DeadTime::One] {
            let settled = verdict(&[], dead_time);
            assert!(settled.settles, "{dead_time:?}: {settled:?}");
            assert!(settled.amplitude_m < 1e-5, "{dead_time:?}: {settled:?}");
        }
        let late = verdict(&["controller.damping_sqrt_kg=0"], DeadTime::Two);
        assert!(!late.settles && late.amplitude_m > 0.01, "{late:?}");
        let damped = verdict(&[], DeadTime::Two);
        assert!(!damped.settles && damped.amplitude_m < 0.5 * late.amplitude_m, "{damped:?}");
    }

    #[test]
    fn gains_slow_torque_filter_needs_joint_damping() {
        let slow = "supervisor.torque_bandwidth_hz=20";
        let bare = verdict(&[slow], DeadTime::One);
        assert!(!bare.settles && bare.amplitude_m > 0.01, "{bare:?}");
        let damped = verdict(&[slow, "robot.joint_damping_n_m_s_per_rad=11.46"], DeadTime::One);
        assert!(damped.settles, "{damped:?}");
    }

    #[test]
    fn gains_low_torque_rate_oscillates() {
        let rate = |value: &str| verdict(&[&format!("supervisor.torque_rate_n_m_per_s={value}")], DeadTime::One);
        assert_eq!(rate("1e7"), verdict(&[], DeadTime::One), "a limit that never acts");
        for saturation in ["clip", "scale"] {
            let saturation = format!("supervisor.torque_saturation={saturation}");
            let slow = verdict(&["supervisor.torque_rate_n_m_per_s=100", &saturation], DeadTime::One);
            assert!(!slow.settles && slow.amplitude_m > 0.01, "{saturation}: {slow:?}");
        }
    }

    #[test]
    fn gains_fidelity_paper_settles() {
        let paper = verdict(&["controller.fidelity=paper"], DeadTime::One);
        assert!(paper.settles, "{paper:?}");
    }
}
