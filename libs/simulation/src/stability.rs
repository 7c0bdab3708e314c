//! Whether a set of gains holds the limb in free air without oscillating, given the dead time of the loop.
//!
//! The law is passive, but a torque that acts a tick late is not: at the gains of the paper the leg settles with one tick of
//! dead time and oscillates for ever with two, and so it does behind a slow torque filter without joint damping. No scenario can
//! be told to be safe by its numbers alone, so it is tried: the whole stack is simulated at the start posture.

use crate::{DeadTime, Simulation, SimulationError};
use hapfic_config::{PERIOD_S, Parameters, Settings};

/// How long it is tried, ticks.
const TICKS: u32 = 3000;
/// The last ticks, over which it has to be still.
const LATE: u32 = 500;
/// Speed that each joint gets as a disturbance, of alternating sign, rad/s (m/s for a prismatic joint).
const KICK: f64 = 0.05;
/// When: by then the brakes, which would swallow it, are off under every dead time.
const KICKED_AFTER: u32 = 2;
/// The foot may move this far in the last ticks, m: settling tails and creeping are below, oscillations above.
const STILL_M: f64 = 2e-4;
/// Fastest that a joint may move in the last ticks, rad/s (m/s for a prismatic joint).
const STILL_RAD_PER_S: f64 = 0.02;

/// What became of the limb.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StabilityResult {
    /// Whether it has come to rest.
    pub settles: bool,
    /// How far the foot moved at the end, m: from one extreme to the other, on the axis where it is most. Infinite if the motion
    /// left the numbers.
    pub amplitude_m: f64,
    /// Fastest joint at the end, rad/s (m/s for a prismatic joint). Infinite as above.
    pub joint_speed: f64,
    /// Whether the foot was, on the average, within x_b of where it is held at the end.
    pub previous_state: bool,
}

/// A set of parameters that a scenario uses and under which the limb does not come to rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unstable {
    /// First tick at which the set is in force; 0 for what the scenario starts with.
    pub at_tick: i64,
    /// The set.
    pub parameters: Parameters,
    /// What became of the limb.
    pub verdict: StabilityResult,
}

impl Unstable {
    /// One line for the one who wrote the scenario.
    #[must_use]
    pub fn warning(&self) -> String {
        let p = &self.parameters;
        let place =
            if self.at_tick == 0 { "controller".to_owned() } else { format!("operator at {} s", self.at_tick as f64 / 1000.0) };
        let motion = if self.verdict.amplitude_m.is_finite() {
            format!("oscillates ({:.2} mm at the end of {} s)", self.verdict.amplitude_m * 1e3, f64::from(TICKS) * PERIOD_S)
        } else {
            "diverges".to_owned()
        };
        format!(
            "warning: {place}: with stiffness {:?} N/m, max_force {:?} N and position_bound {:?} m the limb, held in free air at \
             the start posture, {motion}; {}",
            p.stiffness,
            p.max_force,
            p.position_bound,
            if self.verdict.previous_state {
                "lower the stiffness or add joint damping"
            } else {
                "it sinks out of its bound: max_force does not carry it"
            }
        )
    }
}

/// Holds the limb of a scenario in free air at its start posture under a set of parameters, disturbs it, and looks whether it
/// comes to rest. Takes a fraction of a second.
///
/// Floor and objects are left out, gravity, joint damping, torque filter and peak are the scenario's; the reference rests where
/// the foot starts and no force is wished.
///
/// # Errors
/// [`SimulationError::Plant`] if the limb cannot be simulated at all. One that diverges is a verdict, not an error.
pub fn settles(settings: &Settings, gains: &Parameters, dead_time: DeadTime) -> Result<StabilityResult, SimulationError> {
    let mut free = settings.clone();
    free.world.floor = None;
    free.world.objects.clear();
    free.operator.clear();
    free.initial = Parameters { target_position: None, desired_force: [0.0; 3], ..*gains };
    let mut simulation = Simulation::with_dead_time(&free, dead_time)?;
    let lost = StabilityResult { settles: false, amplitude_m: f64::INFINITY, joint_speed: f64::INFINITY, previous_state: true };
    Ok(watch(&mut simulation, &gains.position_bound).unwrap_or(lost))
}

/// Every set of parameters of a scenario that does not settle with the stack's own dead time; sets with the same gains once.
///
/// # Errors
/// As for [`settles`].
pub fn unstable_sets(settings: &Settings) -> Result<Vec<Unstable>, SimulationError> {
    let mut sets = vec![(0, settings.initial)];
    let mut parameters = settings.initial;
    for change in &settings.operator {
        parameters = parameters.with(change);
        if sets.iter().all(|(_, known)| !same_loop(known, &parameters)) {
            sets.push((change.at_tick, parameters));
        }
    }
    let mut unstable = Vec::new();
    for (at_tick, parameters) in sets {
        let verdict = settles(settings, &parameters, DeadTime::default())?;
        if !verdict.settles {
            unstable.push(Unstable { at_tick, parameters, verdict });
        }
    }
    Ok(unstable)
}

/// Whether two sets make the same loop where no force is wished and nothing is touched.
fn same_loop(a: &Parameters, b: &Parameters) -> bool {
    let gains = |p: &Parameters| (p.stiffness, p.max_force, p.position_bound);
    let rules = |p: &Parameters| (p.saturation, p.gravity_compensation, p.stall_release);
    gains(a) == gains(b) && rules(a) == rules(b)
}

fn watch(simulation: &mut Simulation, bound: &[f64; 3]) -> Result<StabilityResult, SimulationError> {
    let (mut lowest, mut highest) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    let mut joint_speed = 0.0_f64;
    let mut start = [0.0; 3];
    for tick in 0..TICKS {
        let state = simulation.step()?.state;
        if tick == 0 {
            start = state.foot_position;
        }
        if tick >= TICKS - LATE {
            for axis in 0..3 {
                lowest[axis] = lowest[axis].min(state.foot_position[axis]);
                highest[axis] = highest[axis].max(state.foot_position[axis]);
            }
            joint_speed = state.joint_velocity.iter().fold(joint_speed, |most, speed| most.max(speed.abs()));
        }
        if tick == KICKED_AFTER {
            let joints = state.joints as usize;
            for (joint, speed) in simulation.plant().world().qd[..joints].iter_mut().enumerate() {
                *speed += if joint % 2 == 0 { KICK } else { -KICK };
            }
        }
    }
    let amplitude_m = (0..3).map(|axis| highest[axis] - lowest[axis]).fold(0.0, f64::max);
    let previous_state = (0..3).all(|axis| (0.5 * (lowest[axis] + highest[axis]) - start[axis]).abs() <= bound[axis]);
    Ok(StabilityResult {
        settles: amplitude_m <= STILL_M && joint_speed <= STILL_RAD_PER_S,
        amplitude_m,
        joint_speed,
        previous_state,
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_config::OperatorChange;

    fn verdict(overrides: &[&str], dead_time: DeadTime) -> StabilityResult {
        let overrides: Vec<String> = overrides.iter().map(|argument| (*argument).to_owned()).collect();
        let settings = Settings::load("floor", &overrides).unwrap();
        settles(&settings, &settings.initial, dead_time).unwrap()
    }

    #[test]
    fn the_papers_gains_bear_one_tick_of_dead_time_and_not_two() {
        for dead_time in [DeadTime::None, DeadTime::One] {
            let still = verdict(&[], dead_time);
            assert!(still.settles, "{dead_time:?}: {still:?}");
            assert!(still.amplitude_m < 1e-5, "{dead_time:?}: {still:?}");
        }
        let late = verdict(&[], DeadTime::Two);
        assert!(!late.settles && late.amplitude_m > 0.01, "{late:?}");
    }

    #[test]
    fn a_slow_torque_filter_needs_joint_damping() {
        let slow = "supervisor.torque_bandwidth_hz=20";
        let bare = verdict(&[slow], DeadTime::One);
        assert!(!bare.settles && bare.amplitude_m > 0.01, "{bare:?}");
        let damped = verdict(&[slow, "robot.joint_damping_n_m_s_per_rad=11.46"], DeadTime::One);
        assert!(damped.settles, "{damped:?}");
    }

    #[test]
    fn the_printed_law_settles_as_well() {
        let paper = verdict(&["controller.fidelity=paper"], DeadTime::One);
        assert!(paper.settles, "{paper:?}");
    }

    #[test]
    fn a_set_that_oscillates_is_named_once() {
        let mut settings = Settings::load("floor", &[]).unwrap();
        assert!(unstable_sets(&settings).unwrap().is_empty());
        let stiff = settings.initial.stiffness.map(|k| 3.0 * k);
        let change = |at_tick, stiffness| OperatorChange { at_tick, stiffness: Some(stiffness), ..OperatorChange::default() };
        settings.operator = vec![change(100, stiff), change(200, settings.initial.stiffness), change(300, stiff)];
        let found = unstable_sets(&settings).unwrap();
        assert_eq!(found.iter().map(|set| (set.at_tick, set.parameters.stiffness)).collect::<Vec<_>>(), [(100, stiff)]);
        let warning = found[0].warning();
        assert!(warning.starts_with("warning: operator at 0.1 s: with stiffness [18000.0, 18000.0, 36000.0] N/m"), "{warning}");
        assert!(warning.contains("oscillates (") && warning.contains(" mm at the end of 3 s)"), "{warning}");
    }
}
