//! Hints at the correction of a scenario: what a key was probably meant to be.

use crate::alias;
use crate::error::nearest;
use crate::tree::join;

/// Sections whose keys are parameters, which the operator names without the section.
const SECTIONS: [&str; 2] = ["controller", "planner"];

/// Words of other programs and of everyday speech, each with the key that it probably means.
const SYNONYMS: &[(&str, &str)] = &[
    ("force", "desired_force_n"),
    ("f_d", "desired_force_n"),
    ("fd", "desired_force_n"),
    ("target", "target_position_m"),
    ("position", "target_position_m"),
    ("goal", "target_position_m"),
    ("k0", "stiffness_n_per_m"),
    ("gain", "stiffness_n_per_m"),
    ("gains", "stiffness_n_per_m"),
    ("f_max", "max_force_n"),
    ("force_limit", "max_force_n"),
    ("bound", "position_bound_m"),
    ("x_b", "position_bound_m"),
    ("sigma", "search_scale"),
    ("speed", "mean_speed_m_per_s"),
    ("velocity", "mean_speed_m_per_s"),
    ("acceleration", "max_acceleration_m_per_s2"),
    ("orientation", "target_orientation_rpy_rad"),
    ("rpy", "target_orientation_rpy_rad"),
    ("moment", "desired_moment_n_m"),
    ("torque", "desired_moment_n_m"),
    ("time", "at_s"),
    ("t", "at_s"),
    ("joints", "start_position_rad"),
    ("q", "start_position_rad"),
    ("duration", "duration_s"),
];

/// Hint at an unknown key in the table at `path`, which knows the keys `known`.
pub(crate) fn unknown_key(path: &str, key: &str, known: &[&str]) -> String {
    let meant = SYNONYMS.iter().find(|(word, name)| word.eq_ignore_ascii_case(key) && known.contains(name));
    if let Some((_, name)) = meant {
        return format!("did you mean {}?", plain(name));
    }
    // Before a similar word: no key of an entry is called like a section.
    if SECTIONS.contains(&key) && known.contains(&"desired_force_n") {
        return format!("leave {key}. out: an operator's entry names a parameter alone, as taper = 0.1");
    }
    if let Some(near) = nearest(key, known) {
        return format!("did you mean {near}?");
    }
    let section = SECTIONS.iter().find(|section| path.is_empty() && is_parameter(section, key));
    match section {
        Some(section) => format!("did you mean {}?", join(section, key)),
        None => "remove it, or use one of these".to_owned(),
    }
}

/// Whether `controller` or `planner` has a key of this name.
fn is_parameter(section: &str, key: &str) -> bool {
    crate::ranges::of_section(section, alias::canonical(section, key))
}

/// Spelling of a key without unit, if it has one.
fn plain(name: &str) -> &str {
    let spellings = alias::of("operator");
    spellings.iter().find(|(_, full)| *full == name).map_or(name, |(short, _)| *short)
}

/// Hint at a key of a change that has a section before it, as `controller.taper`; `None` if it has none.
pub(crate) fn section_prefix(key: &str) -> Option<String> {
    let (section, rest) = key.split_once('.')?;
    SECTIONS.contains(&section.trim()).then(|| format!("leave {section}. out: write {}", rest.trim()))
}

/// Hint at a value at `path` that has another form than `expected`.
pub(crate) fn form(path: &str, found: &str, expected: &str) -> String {
    if expected == "a list" && found == "a table" {
        return format!("write [[{path}]], with double brackets: the list has a table for each entry");
    }
    // A list of tables reads as [a table, a table].
    if expected == "a table" && found.starts_with("[a table") {
        return format!("write [{path}], with single brackets: there is one");
    }
    "change the value; the documentation of the key shows its form".to_owned()
}
