//! Findings: values of a scenario or of a change that are valid, but unwise.
//!
//! [`Advisor`] compares a parameter set with robot and world, without a simulation: within milliseconds, and the same
//! every time. [`simulated`] adds what only a simulation shows. A finding has the place of its value, what was found and
//! what was expected. It is dangerous if the robot would oscillate, or would push with F_max, or with a force that it
//! cannot hold: then `hapfic set` wants `--force`.
//!
//! What "pulls" means: a surface only pushes. A desired force pulls if it points into the surface that is nearest to the
//! target, against the surface's outward normal n: F_d . n < 0. Objects count where they are now, in a scenario's check
//! where they start.

mod force;
mod orientation;
mod script;
mod simulated;
mod surface;
mod target;

/// Presses on built-in walls, for calibration.
pub(crate) mod walls {
    pub(crate) use super::simulated::{DAMPING_RATIO, STEADY, STIFFNESS, Wall, any_floor};
}

pub use script::degrees_hint;
pub use simulated::{FreeAir, simulated};

use crate::SimulationError;
use crate::calibrate::posture_at;
use hapfic_config::{Diagnostic, Location, OperatorChange, ParameterSettings, Settings};
use hapfic_controller::parameters::TipPose;
use hapfic_messages::State;
use hapfic_robot::{Chain, JointVector, MAX_JOINTS, Reach, RobotError};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use std::fmt;

/// Names of the axes.
const AXES: [&str; 3] = ["x", "y", "z"];

/// A value that is valid, but unwise.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// Place, key, what was found, what was expected, and a hint.
    pub diagnostic: Diagnostic,
    /// Whether a change of a running stack needs `--force`.
    pub dangerous: bool,
    /// What makes it; findings of one cause are one.
    cause: String,
    /// Whether what was found is the whole text: a warning of the robot description, with its place.
    whole_text: bool,
}

impl Finding {
    fn new(diagnostic: Diagnostic, dangerous: bool) -> Self {
        let cause = format!("{} {}", diagnostic.found, diagnostic.expected);
        Self { diagnostic, dangerous, cause, whole_text: false }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let level = if self.dangerous { "danger" } else { "warning" };
        if self.whole_text { write!(f, "{level}: {}", self.diagnostic.found) } else { write!(f, "{level}: {}", self.diagnostic) }
    }
}

/// Origin of a parameter set, for the places of its findings.
#[derive(Clone, Copy, Debug)]
pub enum Source<'a> {
    /// The scenario: an index of [`Settings::operator`], `None` for the initial set.
    Script(Option<usize>),
    /// A change of a running stack: its pairs `KEY=VALUE`.
    Request(&'a [&'a str]),
}

/// Surroundings of a parameter set.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Joint positions, from which a target is approached [rad or m].
    pub q: JointVector,
    /// Poses of the objects, in the order of the scenario [m].
    pub objects: Vec<Isometry3<f64>>,
}

impl Scene {
    /// Surroundings of a published state.
    #[must_use]
    pub fn of_state(state: &State) -> Self {
        let objects = state.objects.iter().take(state.object_count as usize).map(|object| {
            let [i, j, k, w] = object.orientation;
            let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
            Isometry3::from_parts(Translation3::from(object.position), rotation)
        });
        Self { q: state.joint_position, objects: objects.collect() }
    }
}

/// Robot and world of a scenario, with which parameter sets are compared.
#[derive(Clone, Debug)]
pub struct Advisor {
    settings: Settings,
    chain: Chain,
    gravity: Vector3<f64>,
    /// Largest torque of each joint: the smaller one of effort limit and peak [N m or N].
    effort: JointVector,
    start: Scene,
}

/// A parameter set to compare, and what is known about it.
struct Case<'a> {
    set: &'a ParameterSettings,
    change: &'a OperatorChange,
    source: Source<'a>,
    scene: &'a Scene,
    /// Target [m]; the position of the foot at the start if none is set.
    target: Vector3<f64>,
    /// Posture at the target, or as near to it as the joints allow.
    reach: Reach,
}

impl Advisor {
    /// Reads robot and world of a scenario.
    ///
    /// # Errors
    /// [`RobotError`] if the robot description is invalid.
    pub fn new(settings: &Settings) -> Result<Self, RobotError> {
        let chain = Chain::from_settings(&settings.robot)?;
        let (mut q, mut effort) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        q.iter_mut().zip(&settings.robot.start_position).for_each(|(q, start)| *q = *start);
        for (i, joint) in chain.joints().iter().enumerate() {
            let peak = settings.supervisor.torque_peak.as_ref().and_then(|list| list.get(i)).copied();
            effort[i] = peak.unwrap_or(f64::INFINITY).min(joint.effort);
        }
        let objects = settings.world.objects.iter().map(surface::start_pose).collect();
        Ok(Self {
            settings: settings.clone(),
            chain,
            gravity: Vector3::from(settings.world.gravity_m_per_s2),
            effort,
            start: Scene { q, objects },
        })
    }

    /// Surroundings at the start of the scenario.
    #[must_use]
    pub fn start(&self) -> &Scene {
        &self.start
    }

    /// Findings of a parameter set that `change` has made, as far as the change concerns them.
    #[must_use]
    pub fn set(&self, set: &ParameterSettings, change: &OperatorChange, source: Source<'_>, scene: &Scene) -> Vec<Finding> {
        const CONCERNED: [&str; 9] = [
            "target_position",
            "desired_force",
            "stiffness",
            "max_force",
            "position_bound",
            "target_orientation",
            "desired_moment",
            "max_moment",
            "rotation_stiffness",
        ];
        if changed(change, &CONCERNED).is_none() {
            return Vec::new();
        }
        self.case(set, change, source, scene, None).0
    }

    /// Findings of a whole scenario, without simulation: sorted by line, each cause once.
    #[must_use]
    pub fn scenario(&self) -> Vec<Finding> {
        let mut findings = self.script();
        findings.extend(self.chain.warnings().iter().map(|text| self.description(text)));
        let mut set = self.settings.initial;
        let mut scene = self.start.clone();
        let all = everything(&set);
        let (found, mut reach) = self.case(&set, &all, Source::Script(None), &scene, None);
        findings.extend(found);
        for (index, change) in self.settings.operator.iter().enumerate() {
            if change.at_tick >= self.settings.duration_ticks as i64 {
                break;
            }
            set = set.with(change);
            scene.q = reach.q;
            let known = (change.target_position.is_none() && change.target_orientation.is_none()).then_some(reach);
            let (found, next) = self.case(&set, change, Source::Script(Some(index)), &scene, known);
            findings.extend(found);
            reach = next;
        }
        sorted(findings)
    }

    /// A warning about the robot description.
    fn description(&self, text: &str) -> Finding {
        let place = Location::File { name: self.settings.robot.urdf.name.as_str().into(), line: None };
        let [key, expected, help] = [const { String::new() }; 3];
        let diagnostic = Diagnostic { place, key, found: text.to_owned(), expected, help };
        Finding { whole_text: true, ..Finding::new(diagnostic, false) }
    }

    /// Findings of a set, and its posture. `known` is the posture of an unchanged target.
    fn case(
        &self,
        set: &ParameterSettings,
        change: &OperatorChange,
        source: Source<'_>,
        scene: &Scene,
        known: Option<Reach>,
    ) -> (Vec<Finding>, Reach) {
        let start = || self.chain.kinematics(&self.start.q).tip_position();
        let target = set.target_position.map_or_else(start, Vector3::from);
        let reach = known.unwrap_or_else(|| self.reach(set, &target, &scene.q));
        let case = Case { set, change, source, scene, target, reach };
        let mut findings = Vec::new();
        self.force(&case, &mut findings);
        self.target(&case, &mut findings);
        self.orientation(&case, &mut findings);
        (findings, reach)
    }

    /// Posture of a set's target: the position's, and in a pose task the orientation's, too.
    fn reach(&self, set: &ParameterSettings, target: &Vector3<f64>, from: &JointVector) -> Reach {
        if set.rotation.is_none() {
            return self.chain.reach(target, from);
        }
        let posed = ParameterSettings { target_position: Some((*target).into()), ..*set };
        let mut posed_start = posed;
        if let Some(rotation) = &mut posed_start.rotation
            && rotation.target_orientation.is_none()
        {
            rotation.target_orientation = Some(TipPose::of(&self.chain.kinematics(&self.start.q)).rpy);
        }
        let q = posture_at(&self.chain, &posed_start, from);
        let position = self.chain.kinematics(&q).tip_position();
        Reach { q, position, distance_m: (target - position).norm() }
    }

    /// A finding at the value of `name` of a case.
    fn finding(&self, case: &Case<'_>, name: &str, dangerous: bool, [found, expected, help]: [String; 3]) -> Finding {
        let (place, key) = self.place(case.source, name);
        Finding::new(Diagnostic { place, key, found, expected, help }, dangerous)
    }

    fn place(&self, source: Source<'_>, name: &str) -> (Location, String) {
        match source {
            Source::Script(entry) => {
                let key = self.settings.parameter_key(entry, name);
                (self.settings.place(&key), key)
            }
            Source::Request(pairs) => {
                let own = pairs.iter().find(|pair| pair.trim_start().starts_with(name));
                let place = own.map_or_else(|| pairs.join(" "), |pair| (*pair).to_owned());
                (Location::Change(place.into()), name.to_owned())
            }
        }
    }
}

/// Findings of a scenario, with short simulations: sorted by line, each cause once.
///
/// # Errors
/// If the scenario cannot be simulated at all.
pub fn all(settings: &Settings, jobs: usize) -> Result<Vec<Finding>, SimulationError> {
    let advisor = Advisor::new(settings).map_err(hapfic_plant::PlantError::from)?;
    let mut findings = advisor.scenario();
    findings.extend(simulated(&advisor, jobs)?);
    Ok(sorted(findings))
}

/// Keeps the first finding of each cause in the order of time, and sorts by lines, those without a line last.
fn sorted(findings: Vec<Finding>) -> Vec<Finding> {
    let mut once: Vec<Finding> = Vec::with_capacity(findings.len());
    for finding in findings {
        if once.iter().all(|known| known.cause != finding.cause) {
            once.push(finding);
        }
    }
    once.sort_by_key(|finding| finding.diagnostic.place.line().unwrap_or(usize::MAX));
    once
}

/// The change that makes a whole set.
fn everything(set: &ParameterSettings) -> OperatorChange {
    OperatorChange {
        target_position: set.target_position,
        desired_force: Some(set.desired_force),
        stiffness: Some(set.stiffness),
        max_force: Some(set.max_force),
        position_bound: Some(set.position_bound),
        desired_moment: set.rotation.map(|rotation| rotation.desired_moment),
        max_moment: set.rotation.map(|rotation| rotation.max_moment),
        rotation_stiffness: set.rotation.map(|rotation| rotation.rotation_stiffness),
        target_orientation: set.rotation.and_then(|rotation| rotation.target_orientation),
        ..OperatorChange::default()
    }
}

/// First parameter of `names` that a change makes; `None` if it makes none of them.
fn changed(change: &OperatorChange, names: &[&'static str]) -> Option<&'static str> {
    names.iter().copied().find(|name| match *name {
        "target_position" => change.target_position.is_some(),
        "desired_force" => change.desired_force.is_some(),
        "stiffness" => change.stiffness.is_some(),
        "max_force" => change.max_force.is_some(),
        "position_bound" => change.position_bound.is_some(),
        "target_orientation" => change.target_orientation.is_some(),
        "desired_moment" => change.desired_moment.is_some(),
        "max_moment" => change.max_moment.is_some(),
        "rotation_stiffness" => change.rotation_stiffness.is_some(),
        _ => false,
    })
}

/// Formats a number to four digits, an integer with all of them.
fn number(value: f64) -> String {
    let whole = value.fract() == 0.0;
    let digits = if whole { 0 } else { (3.0 - value.abs().log10().floor()).clamp(0.0, 6.0) as usize };
    let text = format!("{value:.digits$}");
    let short = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if short == "-0" { "0".to_owned() } else { short.to_owned() }
}

/// Formats a vector, without its unit.
fn vector(v: [f64; 3]) -> String {
    format!("[{}]", v.map(number).join(", "))
}

#[cfg(test)]
mod tests;
