//! Table of the range of every number in a scenario: for the check, for messages, and for the schema.

use crate::error::{ConfigError, Diagnostic};
use crate::tree::{Node, Value, describe_number, join};
use std::fmt;

/// Range of a number. Neither variant admits nan or inf.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Range {
    /// A number from `low` to `high`; an `open` range excludes `low`.
    Number { low: f64, open: bool, high: f64 },
    /// An integer, both ends included.
    Whole { low: i64, high: i64 },
}

const fn above(low: f64, high: f64) -> Range {
    Range::Number { low, open: true, high }
}

const fn within(low: f64, high: f64) -> Range {
    Range::Number { low, open: false, high }
}

const fn whole(low: i64, high: i64) -> Range {
    Range::Whole { low, high }
}

/// Ranges by key, without list indices. An operator's entry shares the ranges of `controller` and `planner`.
pub(crate) const RANGES: &[(&str, Range)] = &[
    ("duration_s", within(0.001, 86_400.0)),
    ("seed", whole(0, i64::MAX)),
    ("robot.base_position_m", within(-100.0, 100.0)),
    ("robot.base_orientation_rpy_rad", within(-10.0, 10.0)),
    ("robot.start_position_rad", within(-100.0, 100.0)),
    ("robot.joint_damping_n_m_s_per_rad", within(0.0, 1e4)),
    ("robot.effort_limit_n_m", above(0.0, 1e5)),
    ("robot.velocity_limit_rad_per_s", above(0.0, 1e4)),
    ("robot.joint_friction_n_m", within(0.0, 1e4)),
    ("robot.armature_kg_m2", within(0.0, 1e3)),
    ("robot.foot.radius_m", within(1e-3, 1.0)),
    ("robot.foot.size_m", within(1e-3, 1.0)),
    ("robot.foot.offset_m", within(-10.0, 10.0)),
    ("robot.foot.centers_m", within(-1.0, 1.0)),
    ("world.gravity_m_per_s2", within(-100.0, 100.0)),
    ("world.floor.height_m", within(-100.0, 100.0)),
    ("world.floor.stiffness_n_per_m", above(0.0, 1e9)),
    ("world.floor.damping_n_s_per_m", within(0.0, 1e7)),
    ("world.floor.transition_width_m", above(0.0, 0.1)),
    ("world.floor.friction_static", within(0.0, 10.0)),
    ("world.floor.friction_dynamic", within(0.0, 10.0)),
    ("world.floor.critical_speed_m_per_s", above(0.0, 1.0)),
    ("world.object.size_m", within(1e-3, 10.0)),
    ("world.object.radius_m", within(1e-3, 10.0)),
    ("world.object.mass_kg", within(1e-3, 1e4)),
    ("world.object.position_m", within(-100.0, 100.0)),
    ("world.object.orientation_rpy_rad", within(-10.0, 10.0)),
    ("world.object.stiffness_n_per_m", above(0.0, 1e9)),
    ("world.object.damping_n_s_per_m", within(0.0, 1e7)),
    ("world.object.transition_width_m", above(0.0, 0.1)),
    ("world.object.friction_static", within(0.0, 10.0)),
    ("world.object.friction_dynamic", within(0.0, 10.0)),
    ("world.object.critical_speed_m_per_s", above(0.0, 1.0)),
    ("plant.contact_substep_us", whole(1, 20)),
    ("plant.flight_substep_us", whole(1, 200)),
    ("plant.rapier_substep_us", whole(20, 1000)),
    ("plant.softness.frequency_hz", above(0.0, 1000.0)),
    ("plant.softness.damping_ratio", above(0.0, 100.0)),
    ("plant.command_timeout_ticks", whole(1, 100)),
    ("plant.force_noise_n", within(0.0, 100.0)),
    ("plant.brake_damping_n_m_s_per_rad", within(0.0, 1e4)),
    ("controller.stiffness_n_per_m", above(0.0, 1e6)),
    ("controller.max_force_n", above(0.0, 1e5)),
    ("controller.position_bound_m", above(0.0, 1.0)),
    ("controller.taper", above(0.0, 1.0)),
    ("controller.damping_sqrt_kg", within(0.0, 100.0)),
    ("controller.posture_lead_s", within(0.0, 0.02)),
    ("controller.search_scale", above(0.0, 1.0)),
    ("controller.force_resolution_n", above(0.0, 100.0)),
    ("controller.rotation_stiffness_n_m_per_rad", above(0.0, 1e4)),
    ("controller.max_moment_n_m", above(0.0, 1e4)),
    ("controller.rotation_bound_rad", above(0.0, 1.5)),
    ("controller.rotation_damping_sqrt_kg_m", within(0.0, 10.0)),
    ("controller.moment_resolution_n_m", above(0.0, 10.0)),
    ("controller.posture_rad", within(-100.0, 100.0)),
    ("controller.posture_stiffness_n_m_per_rad", within(0.0, 1e4)),
    ("controller.posture_damping_n_m_s_per_rad", within(0.0, 1e3)),
    ("controller.joint_damping_n_m_s_per_rad", within(0.0, 1e3)),
    ("controller.limit_margin_rad", within(0.0, 1.0)),
    ("controller.limit_stiffness_n_m_per_rad", within(0.0, 1e4)),
    ("planner.mean_turn_speed_rad_per_s", above(0.0, 30.0)),
    ("planner.max_turn_acceleration_rad_per_s2", above(0.0, 3000.0)),
    ("planner.mean_speed_m_per_s", above(0.0, 10.0)),
    ("planner.max_acceleration_m_per_s2", above(0.0, 1000.0)),
    ("supervisor.deadline_us", whole(50, 950)),
    ("supervisor.torque_bandwidth_hz", above(0.0, 500.0)),
    ("supervisor.torque_peak_n_m", above(0.0, 1e5)),
    ("supervisor.torque_rate_n_m_per_s", above(0.0, 1e7)),
    ("supervisor.ready_timeout_ms", whole(100, 600_000)),
    ("supervisor.heartbeat_timeout_ms", whole(200, 60_000)),
    ("supervisor.grace_ms", whole(200, 60_000)),
    ("supervisor.stall_timeout_ms", whole(500, 600_000)),
    ("supervisor.tick_timeout_ms", whole(50, 60_000)),
    ("supervisor.restart_budget", whole(0, 1_000_000)),
    ("supervisor.restart_window_ms", whole(100, 3_600_000)),
    ("supervisor.restart_backoff_ms", whole(0, 60_000)),
    ("supervisor.ramp_rate_n_m_per_s", above(0.0, 1e7)),
    ("supervisor.discontinuity_n_m", above(0.0, 1e5)),
    ("supervisor.credit_ticks", whole(1, 1_000_000)),
    ("realtime.priority_plant", whole(1, 98)),
    ("realtime.priority_gate", whole(1, 98)),
    ("realtime.priority_controller", whole(1, 98)),
    ("realtime.priority_planner", whole(1, 98)),
    ("realtime.busy_poll_lead_us", whole(0, 500)),
    ("realtime.core_plant", whole(0, 1023)),
    ("realtime.core_gate", whole(0, 1023)),
    ("realtime.core_controller", whole(0, 1023)),
    ("realtime.core_standby", whole(0, 1023)),
    ("realtime.core_planner", whole(0, 1023)),
    ("recorder.flush_ms", whole(1, 10_000)),
    ("recorder.viewer_rate_hz", within(1.0, 1000.0)),
    ("recorder.chunk_kib", whole(1, 65_536)),
    ("recorder.part_mb", whole(1, 1_000_000)),
    ("recorder.keep_mb", whole(2, 100_000_000)),
    ("recorder.min_free_mb", whole(0, 1_000_000)),
    ("operator.at_s", within(0.0, 86_400.0)),
    ("operator.target_position_m", within(-100.0, 100.0)),
    ("operator.desired_force_n", within(-1e4, 1e4)),
    ("operator.target_orientation_rpy_rad", within(-10.0, 10.0)),
    ("operator.desired_moment_n_m", within(-1e3, 1e3)),
    ("fault.at_s", within(0.0, 86_400.0)),
    ("fault.for_ms", whole(1, 600_000)),
    ("fault.by_us", whole(1, 100_000)),
    ("fault.random.count", whole(1, 100_000)),
    ("fault.random.from_s", within(0.0, 86_400.0)),
    ("fault.random.to_s", within(0.0, 86_400.0)),
];

/// Returns the range of a key that takes numbers.
pub(crate) fn of(key: &str) -> Option<Range> {
    let exact = |wanted: &str| RANGES.iter().find(|(name, _)| *name == wanted).map(|(_, range)| *range);
    exact(key).or_else(|| {
        let name = key.strip_prefix("operator.")?;
        exact(&join("controller", name)).or_else(|| exact(&join("planner", name)))
    })
}

/// Whether a section has a number of this name.
pub(crate) fn of_section(section: &str, name: &str) -> bool {
    RANGES.iter().any(|(key, _)| *key == join(section, name))
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number { low, open, high } => {
                let bracket = if *open { '(' } else { '[' };
                write!(f, "a number in {bracket}{}, {}]", describe_number(*low), describe_number(*high))
            }
            Self::Whole { low, high } => write!(f, "an integer in [{low}, {high}]"),
        }
    }
}

impl Range {
    fn admits(self, value: &Value) -> bool {
        match (self, value) {
            (Self::Number { low, open, high }, Value::Float(number)) => inside(low, open, high, *number),
            (Self::Number { low, open, high }, Value::Integer(number)) => inside(low, open, high, *number as f64),
            (Self::Whole { low, high }, Value::Integer(number)) => (i128::from(low)..=i128::from(high)).contains(number),
            _ => false,
        }
    }
}

/// Returns false for nan.
fn inside(low: f64, open: bool, high: f64, value: f64) -> bool {
    value <= high && if open { value > low } else { value >= low }
}

/// Checks every number of a scenario whose key is known; the reader rejects unknown keys.
pub(crate) fn check(node: &Node) -> Result<(), ConfigError> {
    walk(node, "", "")
}

fn walk(node: &Node, key: &str, path: &str) -> Result<(), ConfigError> {
    match &node.value {
        // A table of numbers by name.
        Value::Table(table) if of(key).is_some() => {
            table.iter().try_for_each(|(name, child)| walk(child, key, &join(path, name)))
        }
        Value::Table(table) => table.iter().try_for_each(|(name, child)| walk(child, &join(key, name), &join(path, name))),
        Value::List(items) => items.iter().enumerate().try_for_each(|(index, item)| walk(item, key, &format!("{path}[{index}]"))),
        _ => of(key).map_or(Ok(()), |range| leaf(node, range, path)),
    }
}

fn leaf(node: &Node, range: Range, path: &str) -> Result<(), ConfigError> {
    if range.admits(&node.value) {
        return Ok(());
    }
    let diagnostic = |help: &str| {
        Box::new(Diagnostic {
            place: node.place.clone(),
            key: path.to_owned(),
            found: node.describe(),
            expected: range.to_string(),
            help: help.to_owned(),
        })
    };
    Err(match (range, &node.value) {
        (_, Value::Float(number)) if !number.is_finite() => {
            ConfigError::OutOfRange(diagnostic("TOML admits nan and inf, a scenario does not: give a finite number"))
        }
        (Range::Whole { .. }, Value::Float(_)) => ConfigError::WrongType(diagnostic("write it without point and exponent")),
        (_, Value::Float(_) | Value::Integer(_)) if path.contains("_rad") && !path.contains("_per_rad") => {
            ConfigError::OutOfRange(diagnostic("angles are in rad: 180 degrees are 3.1416"))
        }
        (_, Value::Float(_) | Value::Integer(_)) => {
            ConfigError::OutOfRange(diagnostic("choose a value in that range; the unit is in the key's name"))
        }
        _ => ConfigError::WrongType(diagnostic("give a plain number, without quotes or unit")),
    })
}
