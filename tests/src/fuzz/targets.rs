//! Fuzz targets, one for each decoder.

mod change;
mod config;
mod draw;
mod fields;
mod log;
mod message;
mod runfile;
mod stage;
mod urdf;

use super::target::FuzzTarget;

/// All targets.
pub static ALL_TARGETS: [FuzzTarget; 6] =
    [config::TARGET, change::TARGET, urdf::TARGET, log::TARGET, message::TARGET, runfile::TARGET];

/// Target with this name.
#[must_use]
pub fn target_named(name: &str) -> Option<&'static FuzzTarget> {
    ALL_TARGETS.iter().find(|target| target.name == name)
}

/// Words of a scenario.
const SCENARIO_WORDS: &[&str] = &[
    "title",
    "description",
    "duration_s",
    "seed",
    "robot",
    "urdf",
    "leg.urdf",
    "base_link",
    "tip_link",
    "start_position_rad",
    "joint_damping_n_m_s_per_rad",
    "effort_limit_n_m",
    "world",
    "gravity_m_per_s2",
    "[world.floor]\n",
    "[[world.object]]\n",
    "name",
    "shape = \"box\"\n",
    "shape = \"ball\"\n",
    "size_m = [0.1, 0.1, 0.1]\n",
    "radius_m = 0.1\n",
    "mass_kg = 1.0\n",
    "position_m",
    "orientation_rpy_rad",
    "stiffness_n_per_m",
    "damping_n_s_per_m",
    "transition_width_m",
    "friction_static",
    "friction_dynamic",
    "critical_speed_m_per_s",
    "plant",
    "contact_substep_us",
    "flight_substep_us",
    "command_timeout_ticks",
    "on_loss = \"restart\"\n",
    "controller",
    "fidelity = \"paper\"\n",
    "max_force_n",
    "position_bound_m",
    "search_scale",
    "force_resolution_n",
    "gravity_compensation",
    "planner",
    "mean_speed_m_per_s",
    "max_acceleration_m_per_s2",
    "[[operator]]\n",
    "at_s = 0.0\n",
    "target_position_m",
    "desired_force_n",
    "[supervisor]\n",
    "standby = false\n",
    "deadline_us",
    "torque_bandwidth_hz",
    "torque_peak_n_m",
    "torque_saturation = \"scale\"\n",
    "torque_rate_n_m_per_s",
    "restart_budget",
    "[realtime]\n",
    "priority_plant",
    "core_gate",
    "[recorder]\n",
    "flush_ms",
    "viewer_rate_hz",
    "chunk_kib",
    "[processes]\n",
    "[[fault]]\n",
    "kind = \"kill\"\n",
    "process = \"planner\"\n",
    "random = { count = 100000, from_s = 0.0, to_s = 1.0 }\n",
    "for_ms = 50\n",
    "by_us = 100\n",
    "true",
    "false",
    "nan",
    "inf",
];
