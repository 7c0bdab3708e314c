//! Names of the joints, bodies and objects that messages carry by index.

use std::collections::BTreeMap;

/// Names of joints, bodies and objects, in the order of the indices that messages carry.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Names {
    /// Joints, from the base to the tip.
    pub joints: Vec<String>,
    /// Bodies with contact geometry, in the order of the scene.
    pub bodies: Vec<String>,
    /// Free bodies, in the order of the scenario.
    pub objects: Vec<String>,
}

impl Names {
    /// Metadata record of a log with the names as `joint.0`, `joint.1`, ..., `body.0`, ..., `object.0`, ...
    pub const METADATA: &'static str = "names";

    /// Name of a body; its number if it has none.
    #[must_use]
    pub fn body(&self, index: u32) -> String {
        name(&self.bodies, "body", index as usize)
    }

    /// Name of an object; its number if it has none.
    #[must_use]
    pub fn object(&self, index: usize) -> String {
        name(&self.objects, "object", index)
    }

    /// Converts the names to a metadata record.
    #[must_use]
    pub fn to_metadata(&self) -> BTreeMap<String, String> {
        let lists = [("joint", &self.joints), ("body", &self.bodies), ("object", &self.objects)];
        lists
            .into_iter()
            .flat_map(|(kind, list)| list.iter().enumerate().map(move |(i, name)| (format!("{kind}.{i}"), name.clone())))
            .collect()
    }

    /// Reads the names from a metadata record; each list ends with its numbering.
    #[must_use]
    pub fn from_metadata(metadata: &BTreeMap<String, String>) -> Self {
        let list = |kind: &str| (0..).map_while(|i: usize| metadata.get(&format!("{kind}.{i}")).cloned()).collect();
        Self { joints: list("joint"), bodies: list("body"), objects: list("object") }
    }
}

fn name(list: &[String], kind: &str, index: usize) -> String {
    list.get(index).cloned().unwrap_or_else(|| format!("{kind} {index}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_metadata_round_trip_keeps_order() {
        let names =
            Names { joints: (0..12).map(|i| format!("joint, {i}")).collect(), bodies: vec!["floor".into()], objects: Vec::new() };
        assert_eq!(Names::from_metadata(&names.to_metadata()), names);
    }

    #[test]
    fn names_index_without_name_gives_number() {
        assert_eq!(Names::default().body(7), "body 7");
    }
}
