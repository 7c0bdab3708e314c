//! Places of a loaded scenario's values, for messages about values that are valid but unwise.

use crate::alias;
use crate::error::Location;
use crate::settings::Settings;
use crate::tree::Node;
use std::sync::Arc;

/// Keys of an operator's entry whose initial value stands in `planner`.
const PLANNER: [&str; 4] =
    ["mean_speed_m_per_s", "max_acceleration_m_per_s2", "mean_turn_speed_rad_per_s", "max_turn_acceleration_rad_per_s2"];

/// The scenario as written, with the place of each value.
///
/// Two scenarios with the same values are equal wherever these stand, so all places are equal.
#[derive(Clone, Debug)]
pub(crate) struct Places {
    tree: Arc<Node>,
    /// Number of operator's entries that became part of the initial set: 0 or 1.
    initial_entries: usize,
}

impl PartialEq for Places {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Places {
    pub(crate) fn new(tree: &Node, initial_entries: usize) -> Self {
        Self { tree: Arc::new(tree.clone()), initial_entries }
    }
}

impl Settings {
    /// Returns the place of a key such as `operator[2].at_s`, or of the nearest table around it if the key is not given.
    #[must_use]
    pub fn place(&self, key: &str) -> Location {
        self.places.tree.place(key)
    }

    /// Returns the key of a parameter in the scenario, by its name in an operator's entry, with or without unit.
    ///
    /// `entry` is an index of [`Settings::operator`]; `None` is the initial set.
    #[must_use]
    pub fn parameter_key(&self, entry: Option<usize>, name: &str) -> String {
        let name = alias::canonical("operator", name);
        if let Some(index) = entry {
            return format!("operator[{}].{name}", index + self.places.initial_entries);
        }
        let first = format!("operator[0].{name}");
        if self.places.initial_entries > 0 && self.places.tree.get(&first).is_some() {
            first
        } else if PLANNER.contains(&name) {
            format!("planner.{name}")
        } else {
            format!("controller.{name}")
        }
    }
}
