//! Conditions of the task, watched online: a stack may be nominal and its task not fine.
//!
//! [`TaskWatch`] observes the messages of every tick, off the real-time path, and returns an event where a condition
//! begins or ends. The process severity is not concerned.

mod energy;
mod flag;
mod follow;
mod force;
pub(crate) mod margin;

pub use follow::TaskFollower;
pub use margin::stability_margin;

use energy::PassivityObserver;
use flag::{Change, Flag};
use force::{EVERY, ForceWindow, WINDOW};
use hapfic_config::{PERIOD_S, Settings};
use hapfic_controller::{ForceProfile, task_space};
use hapfic_messages::{
    Command, Detector, Event, EventKind, Mode, Parameters, Process, Reference, Severity, State, TaskCondition,
};
use hapfic_robot::Chain;
use serde::{Deserialize, Serialize};

const AXES: [&str; 3] = ["x", "y", "z"];
/// Share of F_d by which a force is missed.
const MISSED: f64 = 0.05;
/// Ticks of a constant F_d after which a force counts as missed.
const MISSED_TICKS: i64 = 1000;
/// Root mean square of an oscillation over F_d.
const OSCILLATES: f64 = 0.03;
/// Share of the profile's largest force that counts as at the limit.
const AT_LIMIT: f64 = 0.98;
/// Ticks for which a condition of position or force holds before it begins or ends.
const HOLD: i64 = 50;
/// Ticks for which the reference rests and the foot stays away before a target counts as out of reach.
const REST: i64 = 300;
/// Orientation error at rest that counts as not reached [rad]: one degree.
const TURNED: f64 = 0.0175;
/// Distance to a joint's limit that counts as at its stop [rad], or [m] for a prismatic joint.
const STOP: f64 = 2e-3;
/// Share of the rule's limit from which on the margin is small.
const MARGIN: f64 = 0.8;
/// Fall of the passivity observer within 100 ms over F_max x_b.
const FALL: f64 = 0.05;

/// A condition that holds, or has held.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TaskReport {
    /// Name of the condition.
    pub condition: String,
    /// Axis of the world or name of the joint; empty for the whole robot.
    pub place: String,
    /// Tick since which it holds; `None` if it has ended.
    pub since_tick: Option<i64>,
    /// Number of beginnings.
    pub times: u64,
    /// Time for which it held in all [s].
    pub total_s: f64,
    /// What was found when it last began.
    pub found: String,
}

/// A watched condition at a place.
#[derive(Clone, Debug)]
struct Watched {
    condition: TaskCondition,
    place: String,
    flag: Flag,
    found: String,
}

/// Watch of the conditions.
#[derive(Clone, Debug)]
pub struct TaskWatch {
    chain: Chain,
    /// Delay of the torque: dead time, half a tick and the torque filter [s].
    tau_s: f64,
    watched: Vec<Watched>,
    force: [ForceWindow; 3],
    moment: [ForceWindow; 3],
    energy: [PassivityObserver; 3],
    /// Command of the tick before, and the version of its parameters.
    before: Option<Command>,
    /// Ticks for which the reference has been at the target.
    arrived: i64,
    /// Ticks for which the reference has not turned.
    still: i64,
    margin: f64,
    last_tick: i64,
}

impl TaskWatch {
    /// Watch of a scenario's robot.
    #[must_use]
    pub fn new(settings: &Settings, chain: Chain) -> Self {
        let filter_s = settings.supervisor.torque_bandwidth_hz.map_or(0.0, |hz| 1.0 / (core::f64::consts::TAU * hz));
        let of =
            |condition, place: &str| Watched { condition, place: place.to_owned(), flag: Flag::default(), found: String::new() };
        let mut watched = Vec::new();
        for condition in TaskCondition::ALL.iter().copied() {
            match condition {
                TaskCondition::AtJointStop | TaskCondition::OverSpeed => {
                    watched.extend(chain.joints().iter().map(|joint| of(condition, &joint.name)))
                }
                TaskCondition::StabilityMargin => watched.push(of(condition, "")),
                _ => watched.extend(AXES.map(|axis| of(condition, axis))),
            }
        }
        Self {
            chain,
            tau_s: 1.5 * PERIOD_S + filter_s,
            watched,
            force: Default::default(),
            moment: Default::default(),
            energy: Default::default(),
            before: None,
            arrived: 0,
            still: 0,
            margin: 0.0,
            last_tick: -1,
        }
    }

    /// Conditions that hold or have held.
    #[must_use]
    pub fn report(&self) -> Vec<TaskReport> {
        let seen = self.watched.iter().filter(|watched| watched.flag.times > 0);
        seen.map(|watched| TaskReport {
            condition: watched.condition.name().to_owned(),
            place: watched.place.clone(),
            since_tick: watched.flag.began,
            times: watched.flag.times,
            total_s: watched.flag.ticks(self.last_tick) as f64 * PERIOD_S,
            found: watched.found.clone(),
        })
        .collect()
    }

    /// Observes a tick; returns an event for each condition that begins or ends in it.
    pub fn push(&mut self, state: &State, reference: &Reference, command: &Command, p: &Parameters) -> Vec<Event> {
        let tick = state.tick;
        self.last_tick = tick;
        let active = command.mode == Mode::Active.code();
        let mut found = Observations { tick, severity: command.severity, events: Vec::new() };
        let target = (0..3).all(|i| (reference.position[i] - p.target_position[i]).abs() < 1e-6);
        self.arrived = if target { self.arrived + 1 } else { 0 };
        let acted = self.acted(state);
        for axis in 0..3 {
            let (force, desired) = (state.foot_force[axis], p.desired_force[axis]);
            self.force[axis].push(force, axis, p);
            let profile = profile(p, axis);
            let contact = force.abs() > p.force_resolution;
            if tick % EVERY == 0 {
                let constant = self.force[axis].constant;
                let figures = self.force[axis].figures();
                let watched = active && desired != 0.0;
                let error = figures.mean - desired;
                let missed = watched && constant >= MISSED_TICKS && error.abs() > MISSED * desired.abs();
                self.observe(&mut found, TaskCondition::ForceNotReached, axis, missed, 0, || {
                    format!("mean {:.2} N instead of {desired:.2} N", figures.mean)
                });
                let oscillates = watched && constant >= WINDOW as i64 && figures.oscillation > OSCILLATES * desired.abs();
                self.observe(&mut found, TaskCondition::ForceOscillates, axis, oscillates, 0, || {
                    format!("rms {:.1} % of {desired:.2} N", 100.0 * figures.oscillation / desired.abs())
                });
            }
            let request = &command.request;
            let at_limit = active && request.force[axis].abs() >= AT_LIMIT * profile.largest();
            self.observe(&mut found, TaskCondition::ForceAtLimit, axis, at_limit, HOLD, || {
                format!("F_c {:.1} N of {:.1} N", request.force[axis], profile.largest())
            });
            let distance = reference.position[axis] - state.foot_position[axis];
            let outside = active && distance.abs() > p.position_bound[axis];
            let held = desired != 0.0 && contact;
            self.observe(&mut found, TaskCondition::OutsideBound, axis, outside && !held, HOLD, || {
                format!("{:.1} mm off the reference, x_b {:.1} mm", 1e3 * distance, 1e3 * p.position_bound[axis])
            });
            let unreachable = outside && !contact && self.arrived > REST;
            self.observe(&mut found, TaskCondition::TargetOutOfReach, axis, unreachable, REST, || {
                format!("{:.1} mm off the target", 1e3 * distance)
            });
            let fall = self.fall(axis, state, reference, acted, &profile);
            let whole = p.max_force[axis] * p.position_bound[axis];
            self.observe(&mut found, TaskCondition::NotPassive, axis, active && fall > FALL * whole, 0, || {
                format!("{fall:.3} J more than reference and spring explain within 100 ms")
            });
        }
        if p.is_pose() {
            let turns = reference.angular_velocity.iter().any(|rate| rate.abs() > 1e-9);
            self.still = if turns { 0 } else { self.still + 1 };
            self.rotation(&mut found, active, state, command, p);
        }
        self.joints(&mut found, state, p);
        self.before = Some(*command);
        found.events
    }

    /// Error of the orientation, and the moment.
    fn rotation(&mut self, found: &mut Observations, active: bool, state: &State, command: &Command, p: &Parameters) {
        let request = &command.request.rotation;
        let law = p.of_rotation();
        for axis in 0..3 {
            let error = request.error[axis] - request.state.offset[axis];
            let bound = p.rotation.bound[axis];
            let held = p.rotation.desired_moment[axis] != 0.0;
            let outside = active && !held && error.abs() > bound;
            self.observe(found, TaskCondition::RotationOutsideBound, axis, outside, HOLD, || {
                format!("{:.2} degrees off the reference, x_b,R {:.2} degrees", error.to_degrees(), bound.to_degrees())
            });
            let turned = active && !held && self.still > REST && error.abs() > TURNED;
            self.observe(found, TaskCondition::OrientationNotReached, axis, turned, REST, || {
                format!("{:.2} degrees off the reference at rest", error.to_degrees())
            });
            let desired = law.desired_force[axis];
            self.moment[axis].push(state.foot_moment[axis], axis, &law);
            if found.tick % EVERY == 0 {
                let mean = self.moment[axis].figures().mean;
                let constant = self.moment[axis].constant >= MISSED_TICKS;
                let missed = active && desired != 0.0 && constant && (mean - desired).abs() > MISSED * desired.abs();
                self.observe(found, TaskCondition::MomentNotReached, axis, missed, 0, || {
                    format!("mean {mean:.3} N m instead of {desired:.3} N m")
                });
            }
        }
    }

    /// Stops, speeds and margin.
    fn joints(&mut self, found: &mut Observations, state: &State, p: &Parameters) {
        let limits: Vec<(f64, f64)> = self.chain.joints().iter().map(|joint| (joint.lower, joint.upper)).collect();
        for (index, (lower, upper)) in limits.into_iter().enumerate() {
            let q = state.joint_position[index];
            let stop = q <= lower + STOP || q >= upper - STOP;
            self.observe(found, TaskCondition::AtJointStop, index, stop, HOLD, || format!("{q:.4} in [{lower:.4}, {upper:.4}]"));
            let (speed, limit) = (state.joint_velocity[index], self.chain.joints()[index].velocity_limit);
            self.observe(found, TaskCondition::OverSpeed, index, speed.abs() > limit, HOLD, || {
                format!("{speed:.2} of {limit:.2} rad/s or m/s")
            });
        }
        if found.tick % (2 * EVERY) == 0 {
            self.margin = stability_margin(&self.chain, &state.joint_position, p, self.tau_s).unwrap_or(0.0);
            let margin = self.margin;
            self.observe(found, TaskCondition::StabilityMargin, 0, margin > MARGIN, 0, || {
                format!("omega tau at {:.0} % of its limit", 100.0 * margin)
            });
        }
    }

    fn observe(
        &mut self,
        found: &mut Observations,
        condition: TaskCondition,
        index: usize,
        holds: bool,
        hold: i64,
        describe: impl FnOnce() -> String,
    ) {
        let Some(watched) = self.watched.iter_mut().filter(|watched| watched.condition == condition).nth(index) else { return };
        let Some(change) = watched.flag.observe(found.tick, holds, hold) else { return };
        let place = if watched.place.is_empty() { String::new() } else { format!(" on {}", watched.place) };
        let text = match change {
            Change::Began => {
                watched.found = describe();
                format!("{condition}{place} began: {}", watched.found)
            }
            Change::Ended(ticks) => format!("{condition}{place} ended after {:.3} s", ticks as f64 * PERIOD_S),
        };
        let severity = Severity::from_code(found.severity).unwrap_or(Severity::Nominal);
        found.events.push(Event::new(found.tick, Process::Controller, EventKind::Condition, severity, Detector::Task, &text));
    }

    /// Force that acted since the state before [N]: F_c of the last command, or what the conditioned torque made of it.
    fn acted(&self, state: &State) -> [f64; 3] {
        let Some(before) = &self.before else { return [0.0; 3] };
        if before.mode != Mode::Active.code() {
            return [0.0; 3];
        }
        let n = self.chain.dof();
        if (0..n).all(|i| before.torque[i] == before.request.torque[i]) {
            return before.request.force;
        }
        // The change of the torque as a force: least squares, damped near a singular posture.
        let kin = self.chain.kinematics(&state.joint_position[..n]);
        let jacobian = self.chain.jacobian(&kin);
        let rows = nalgebra::Matrix3xX::from_fn(n, |row, column| jacobian.linear[column][row]);
        let change = nalgebra::DVector::from_fn(n, |i, _| before.torque[i] - before.request.torque[i]);
        let square = &rows * rows.transpose() + nalgebra::Matrix3::identity() * 1e-4;
        let force = square.try_inverse().map_or_else(nalgebra::Vector3::zeros, |inverse| inverse * (rows * change));
        core::array::from_fn(|axis| before.request.force[axis] + force[axis])
    }

    fn fall(&mut self, axis: usize, state: &State, reference: &Reference, acted: [f64; 3], profile: &ForceProfile) -> f64 {
        let same = self.before.is_some_and(|before| {
            before.mode == Mode::Active.code()
                && before.request.state.stiffness[axis] == profile.stiffness
                && before.request.state.max_force[axis] == profile.max_force
                && before.request.state.position_bound[axis] == profile.position_bound
        });
        let observer = &mut self.energy[axis];
        if !same {
            observer.reset();
        }
        let offset = self.before.map_or(0.0, |before| before.request.state.offset[axis]);
        observer.push(state.foot_position[axis], reference.position[axis] + offset, acted[axis], profile)
    }
}

/// Events of a tick.
struct Observations {
    tick: i64,
    severity: u32,
    events: Vec<Event>,
}

fn profile(p: &Parameters, axis: usize) -> ForceProfile {
    let saturation = task_space::policies(p).map_or(hapfic_messages::Saturation::Softening, |policies| policies.saturation);
    ForceProfile {
        stiffness: p.stiffness[axis],
        max_force: p.max_force[axis],
        position_bound: p.position_bound[axis],
        saturation,
    }
}
