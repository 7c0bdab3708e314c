//! Gains that a robot bears at the loop's dead time: the rule of the stability margin at a set of postures, verified by short
//! simulations in free air and on walls.
//!
//! The rule: `omega tau <= 0.32 + 2.3 zeta` for every mode of the task's stiffness (see [`stability_margin`]). A proposal keeps
//! 16 % of omega tau, which is 30 % of the stiffness, at the worst posture. Then the stack is simulated with it, and with 1.4
//! times its stiffness in free air.
//!
//! [`stability_margin`]: crate::conditions::stability_margin

mod masses;
mod postures;

pub use masses::{EffectiveMasses, effective_masses};

use crate::conditions::margin::{CriticalMode, critical_mode};
use crate::findings::Advisor;
use crate::findings::walls::{self, Wall};
use crate::stability::settles;
use crate::{DeadTime, SimulationError};
use hapfic_config::{PERIOD_S, ParameterSettings, Settings};
use hapfic_controller::parameters::{TipPose, parameters};
use hapfic_robot::{Chain, JointVector, MAX_JOINTS};
use nalgebra::Vector3;
pub(crate) use postures::posture_at;
use postures::postures;
pub use postures::start_posture;

/// Largest share of the limit of omega tau that a proposal uses: 0.7 of the stiffness.
const SHARE: f64 = 0.84;
/// Factor of the stiffness with which the limb must still come to rest in free air.
const RESERVE: f64 = 1.4;
/// Damping over the root of an effective mass or inertia: a damping ratio of 0.35.
const DAMPING: f64 = 0.7;
/// Largest product of the damping and the delay over the smallest mass or inertia: a damping acts late, too.
const DELAYED_DAMPING: f64 = 0.25;
/// Stiffness beyond which a task gains nothing [N/m]; [N m/rad].
const ENOUGH: (f64, f64) = (12_000.0, 100.0);
/// Ratio of the largest moment to K_R [rad]: of F_max to K0 it is x_b.
const ROTATION_BOUND_RAD: f64 = 0.3;
/// Position bound [m].
const POSITION_BOUND_M: f64 = 0.025;
/// Share of the joints' effort that force and weight together may take.
const SHARE_OF_EFFORT: f64 = 0.8;
/// Factor of the stiffness after a simulation that failed, and most such steps.
const STEP: f64 = 0.7;
const STEPS: usize = 8;

/// A proposal, and how it came about.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The proposed set.
    pub set: ParameterSettings,
    /// Number of postures considered.
    pub postures: usize,
    /// Smallest effective masses over them.
    pub masses: EffectiveMasses,
    /// The mode that limits, with the proposal.
    pub mode: CriticalMode,
    /// Margin with one more tick of dead time.
    pub margin_one_more: f64,
    /// Largest force on each axis that the efforts allow beside the weight [N].
    pub bearable_n: [f64; 3],
    /// Force that was asked for [N].
    pub asked_n: f64,
    /// Force of the presses on walls [N]; `None` if the robot cannot press on a floor in its posture.
    pub pressed_n: Option<f64>,
    /// Walls on which the force did not become steady: stiffness [N/m], damping ratio, error relative to the force.
    pub unsteady: Vec<(f64, f64, f64)>,
    /// Steps by which a simulation lowered the rule's stiffness.
    pub lowered: usize,
    /// Whether the limb settles with 1.4 times the stiffness.
    pub reserve: bool,
}

/// Finds gains for a scenario's robot at its start posture and at those of its targets.
///
/// `force` [N] is the force to hold on z; `None`: the largest of the scenario, or else 20 N.
///
/// # Errors
/// [`SimulationError`] if the robot cannot be built or simulated at all.
pub fn calibrate(settings: &Settings, force: Option<f64>) -> Result<Calibration, SimulationError> {
    let chain = Chain::from_settings(&settings.robot).map_err(hapfic_plant::PlantError::from)?;
    let postures = postures(settings, &chain);
    let masses = postures.iter().filter_map(|q| effective_masses(&chain, q)).reduce(|a, b| a.smaller(&b)).unwrap_or_default();
    let tau_s = delay(settings);
    let scripted = settings.operator.iter().filter_map(|change| change.desired_force).map(|f| f[2].abs());
    let force = force.unwrap_or_else(|| match scripted.fold(settings.initial.desired_force[2].abs(), f64::max) {
        0.0 => 20.0,
        most => most,
    });
    let pose = settings.initial.rotation.is_some();
    let bearable_n = bearable(settings, &chain, &postures);
    let mut scale = scale_by_rule(settings, &chain, &postures, &masses, tau_s);
    let mut lowered = 0;
    loop {
        let set = proposal(settings, &masses, scale, &bearable_n, force);
        let mut pressing = settings.clone();
        pressing.world.floor.get_or_insert(walls::any_floor());
        let advisor = Advisor::new(&pressing).map_err(hapfic_plant::PlantError::from)?;
        let free = settles(settings, &set, DeadTime::default())?.settles;
        let pressed_n = force.min(0.8 * set.max_force[2]);
        let place = place_of_force(settings);
        let mut press = ParameterSettings { desired_force: [0.0, 0.0, pressed_n], target_position: place.target_position, ..set };
        if let (Some(rotation), Some(place)) = (&mut press.rotation, place.rotation) {
            rotation.target_orientation = place.target_orientation;
        }
        let (mut unsteady, mut tried) = (Vec::new(), true);
        for stiffness in walls::STIFFNESS {
            for damping_ratio in walls::DAMPING_RATIO {
                match advisor.press(&press, Wall { stiffness, damping_ratio }) {
                    Some(error) if error > walls::STEADY => unsteady.push((stiffness, damping_ratio, error)),
                    Some(_) => {}
                    None => tried = false,
                }
            }
        }
        let reserve = free && settles(settings, &scaled(&set, RESERVE, pose), DeadTime::default())?.settles;
        if (reserve && unsteady.is_empty()) || lowered >= STEPS {
            let modes = postures.iter().filter_map(|q| critical_mode(&chain, q, &published(&set), tau_s));
            let mode = modes.max_by(|a, b| a.margin.total_cmp(&b.margin));
            let none = CriticalMode { margin: f64::INFINITY, frequency_hz: 0.0, zeta: 0.0, shares: [0.0; 6] };
            let mode = mode.unwrap_or(none);
            return Ok(Calibration {
                postures: postures.len(),
                masses,
                margin_one_more: mode.margin * (tau_s + PERIOD_S) / tau_s,
                mode,
                bearable_n,
                asked_n: force,
                pressed_n: tried.then_some(pressed_n),
                unsteady,
                lowered,
                reserve,
                set,
            });
        }
        lowered += 1;
        scale *= STEP;
    }
}

/// The set of the script under which it desires its largest force on z: where the walls are tried. The initial one without.
fn place_of_force(settings: &Settings) -> ParameterSettings {
    let mut set = settings.initial;
    let mut place = set;
    for change in &settings.operator {
        set = set.with(change);
        if set.desired_force[2].abs() > place.desired_force[2].abs() {
            place = set;
        }
    }
    place
}

/// Delay from a state to the middle of the tick in which its torque acts, with the torque filter [s].
fn delay(settings: &Settings) -> f64 {
    let filter_s = settings.supervisor.torque_bandwidth_hz.map_or(0.0, |hz| 1.0 / (core::f64::consts::TAU * hz));
    1.5 * PERIOD_S + filter_s
}

fn published(set: &ParameterSettings) -> hapfic_messages::Parameters {
    parameters(set, 1, 0, &TipPose::default())
}

/// A set with so many times its stiffness; the largest force grows with it, so that the profile keeps its shape.
fn scaled(set: &ParameterSettings, by: f64, pose: bool) -> ParameterSettings {
    let mut scaled = *set;
    scaled.stiffness = set.stiffness.map(|k| by * k);
    scaled.max_force = set.max_force.map(|f| by * f);
    if let Some(rotation) = scaled.rotation.as_mut().filter(|_| pose) {
        rotation.rotation_stiffness = rotation.rotation_stiffness.map(|k| by * k);
        rotation.max_moment = rotation.max_moment.map(|t| by * t);
    }
    scaled
}

/// Share of the single axes' limits that all axes together bear at the worst posture.
fn scale_by_rule(settings: &Settings, chain: &Chain, postures: &[JointVector], masses: &EffectiveMasses, tau_s: f64) -> f64 {
    let margin = |scale: f64| {
        let set = published(&unbounded(settings, masses, scale));
        let margins = postures.iter().filter_map(|q| critical_mode(chain, q, &set, tau_s)).map(|mode| mode.margin);
        margins.fold(0.0, f64::max)
    };
    let (mut low, mut high) = (0.0, 4.0);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if margin(middle) <= SHARE { low = middle } else { high = middle }
    }
    low
}

/// Gains at a share of `0.1 m / tau^2`, the limit of a single undamped axis, and the damping that goes with the masses.
fn unbounded(settings: &Settings, masses: &EffectiveMasses, scale: f64) -> ParameterSettings {
    let tau_s = delay(settings);
    let limit = |inertia: f64| 0.1 * inertia / (tau_s * tau_s);
    let mut set = settings.initial;
    // For the heaviest direction, as far as the lightest one bears it.
    let damping =
        |least: f64, most: f64, stiffness: f64| (DAMPING * most.sqrt()).min(DELAYED_DAMPING * least / (tau_s * stiffness.sqrt()));
    set.stiffness = [two_digits((scale * limit(masses.least_kg)).min(ENOUGH.0)); 3];
    set.damping = two_digits(damping(masses.least_kg, masses.most_kg, set.stiffness[0]));
    if let Some(rotation) = &mut set.rotation {
        rotation.rotation_stiffness = [two_digits((scale * limit(masses.least_kg_m2)).min(ENOUGH.1)); 3];
        let stiffness = rotation.rotation_stiffness[0];
        rotation.rotation_damping = two_digits(damping(masses.least_kg_m2, masses.most_kg_m2, stiffness));
    }
    set
}

/// The gains with bounds and limits.
fn proposal(settings: &Settings, masses: &EffectiveMasses, scale: f64, bearable_n: &[f64; 3], force: f64) -> ParameterSettings {
    let mut set = unbounded(settings, masses, scale);
    let k0 = set.stiffness[0];
    // The search has to reach the force and as much again.
    let bound = (POSITION_BOUND_M).max(two_digits_up(2.0 * force / k0));
    set.position_bound = [bound; 3];
    set.max_force = bearable_n.map(|most| two_digits((0.95 * k0 * bound).min(most)));
    set.gravity_compensation = settings.initial.gravity_compensation;
    if let Some(rotation) = &mut set.rotation {
        rotation.rotation_bound = [ROTATION_BOUND_RAD; 3];
        rotation.max_moment = rotation.rotation_stiffness.map(|k| two_digits(0.95 * k * ROTATION_BOUND_RAD));
    }
    set
}

/// Largest force on each axis that the joints bear beside the weight, at the worst posture [N].
fn bearable(settings: &Settings, chain: &Chain, postures: &[JointVector]) -> [f64; 3] {
    let gravity = Vector3::from(settings.world.gravity_m_per_s2);
    core::array::from_fn(|axis| {
        let mut most = f64::INFINITY;
        for q in postures {
            let kin = chain.kinematics(q);
            let (jacobian, weight) = (chain.jacobian(&kin), chain.gravity_torque(&kin, &gravity));
            for (i, joint) in chain.joints().iter().enumerate() {
                let peak = settings.supervisor.torque_peak.as_ref().and_then(|list| list.get(i)).copied();
                let effort = SHARE_OF_EFFORT * joint.effort.min(peak.unwrap_or(f64::INFINITY));
                let arm = jacobian.linear[i][axis].abs();
                if arm > 1e-9 {
                    most = most.min((effort - weight[i].abs()).max(0.0) / arm);
                }
            }
        }
        most
    })
}

/// A number cut to two digits.
fn two_digits(value: f64) -> f64 {
    round(value, f64::floor)
}

/// A number raised to two digits.
fn two_digits_up(value: f64) -> f64 {
    round(value, f64::ceil)
}

fn round(value: f64, by: fn(f64) -> f64) -> f64 {
    if value <= 0.0 || !value.is_finite() {
        return value;
    }
    let unit = 10_f64.powf(value.log10().floor() - 1.0);
    // Through text, so that the number is the one that is printed.
    format!("{:.12e}", by(value / unit * (1.0 + 1e-12)) * unit).parse().unwrap_or(value)
}

/// A posture with zeros beyond the chain's joints.
pub(crate) fn padded(values: &[f64]) -> JointVector {
    let mut q = [0.0; MAX_JOINTS];
    q.iter_mut().zip(values).for_each(|(q, value)| *q = *value);
    q
}
