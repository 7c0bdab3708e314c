//! Aliases of the keys that carry a unit: the plain names that the log uses.

use crate::error::{ConfigError, Diagnostic};
use crate::tree::{Node, Value, join};
use std::collections::BTreeMap;

const CONTROLLER: &[(&str, &str)] = &[
    ("stiffness", "stiffness_n_per_m"),
    ("max_force", "max_force_n"),
    ("position_bound", "position_bound_m"),
    ("force_resolution", "force_resolution_n"),
    ("damping", "damping_sqrt_kg"),
    ("posture_lead", "posture_lead_s"),
    ("rotation_stiffness", "rotation_stiffness_n_m_per_rad"),
    ("max_moment", "max_moment_n_m"),
    ("rotation_bound", "rotation_bound_rad"),
    ("rotation_damping", "rotation_damping_sqrt_kg_m"),
    ("moment_resolution", "moment_resolution_n_m"),
    ("posture", "posture_rad"),
    ("posture_stiffness", "posture_stiffness_n_m_per_rad"),
    ("posture_damping", "posture_damping_n_m_s_per_rad"),
    ("joint_damping", "joint_damping_n_m_s_per_rad"),
    ("limit_margin", "limit_margin_rad"),
    ("limit_stiffness", "limit_stiffness_n_m_per_rad"),
];

const PLANNER: &[(&str, &str)] = &[
    ("mean_speed", "mean_speed_m_per_s"),
    ("max_acceleration", "max_acceleration_m_per_s2"),
    ("mean_turn_speed", "mean_turn_speed_rad_per_s"),
    ("max_turn_acceleration", "max_turn_acceleration_rad_per_s2"),
];

const OPERATOR: &[(&str, &str)] = &[
    ("at", "at_s"),
    ("target_position", "target_position_m"),
    ("desired_force", "desired_force_n"),
    ("stiffness", "stiffness_n_per_m"),
    ("max_force", "max_force_n"),
    ("position_bound", "position_bound_m"),
    ("force_resolution", "force_resolution_n"),
    ("damping", "damping_sqrt_kg"),
    ("posture_lead", "posture_lead_s"),
    ("mean_speed", "mean_speed_m_per_s"),
    ("max_acceleration", "max_acceleration_m_per_s2"),
    ("target_orientation", "target_orientation_rpy_rad"),
    ("desired_moment", "desired_moment_n_m"),
    ("rotation_stiffness", "rotation_stiffness_n_m_per_rad"),
    ("max_moment", "max_moment_n_m"),
    ("rotation_bound", "rotation_bound_rad"),
    ("rotation_damping", "rotation_damping_sqrt_kg_m"),
    ("moment_resolution", "moment_resolution_n_m"),
    ("mean_turn_speed", "mean_turn_speed_rad_per_s"),
    ("max_turn_acceleration", "max_turn_acceleration_rad_per_s2"),
];

/// Aliases in a section, each with the name of its key.
pub(crate) fn of(section: &str) -> &'static [(&'static str, &'static str)] {
    match section {
        "controller" => CONTROLLER,
        "planner" => PLANNER,
        "operator" => OPERATOR,
        _ => &[],
    }
}

/// Name of a key of a section, given as name or as alias.
pub(crate) fn canonical<'a>(section: &str, key: &'a str) -> &'a str {
    of(section).iter().find(|(alias, _)| *alias == key).map_or(key, |(_, name)| *name)
}

/// Replaces every alias in a scenario by the name of its key.
pub(crate) fn canonicalise(root: &mut Node) -> Result<(), ConfigError> {
    let Value::Table(sections) = &mut root.value else { return Ok(()) };
    for section in ["controller", "planner"] {
        if let Some(Node { value: Value::Table(table), .. }) = sections.get_mut(section) {
            rename(table, section, section)?;
        }
    }
    if let Some(Node { value: Value::List(entries), .. }) = sections.get_mut("operator") {
        for (index, entry) in entries.iter_mut().enumerate() {
            if let Value::Table(table) = &mut entry.value {
                rename(table, "operator", &format!("operator[{index}]"))?;
            }
        }
    }
    Ok(())
}

fn rename(table: &mut BTreeMap<String, Node>, section: &str, path: &str) -> Result<(), ConfigError> {
    for (alias, name) in of(section) {
        let Some(node) = table.remove(*alias) else { continue };
        if let Some(other) = table.get(*name) {
            return Err(ConfigError::Combination(Box::new(Diagnostic {
                place: node.place,
                key: join(path, alias),
                found: format!("a second spelling of {name}, which is given at {}", other.place),
                expected: "one of the two".to_owned(),
                help: format!("remove {alias}"),
            })));
        }
        table.insert((*name).to_owned(), node);
    }
    Ok(())
}
