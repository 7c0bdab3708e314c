//! Values per joint, as written.

use crate::settings::JointValues;
use schemars::JsonSchema;
use serde::de::{Error, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// One number for all joints, a list with one number for each, or a table by the names of joints.
#[derive(Clone, Debug, JsonSchema, Serialize)]
#[serde(untagged)]
pub(crate) enum PerJoint {
    /// The same number for all joints.
    All(f64),
    /// Numbers in the order of the chain, from base to tip.
    Each(Vec<f64>),
    /// Numbers by joint; the others keep the description's.
    Named(BTreeMap<String, f64>),
}

impl PerJoint {
    /// Returns a number for each joint: as written, or the one number for all; `None` for a table, which only the robot
    /// model can put in order.
    pub(crate) fn expand(self, joints: usize) -> Option<Vec<f64>> {
        match self {
            Self::All(number) => Some(vec![number; joints]),
            Self::Each(numbers) => Some(numbers),
            Self::Named(_) => None,
        }
    }

    /// Returns the values for the robot model.
    pub(crate) fn values(self, joints: usize) -> JointValues {
        match self {
            Self::All(number) => JointValues::InOrder(vec![number; joints]),
            Self::Each(numbers) => JointValues::InOrder(numbers),
            Self::Named(table) => JointValues::ByName(table.into_iter().collect()),
        }
    }
}

// By hand: the derived code of an untagged enum loses the invalid element.
impl<'de> Deserialize<'de> for PerJoint {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(PerJointVisitor)
    }
}

struct PerJointVisitor;

impl<'de> Visitor<'de> for PerJointVisitor {
    type Value = PerJoint;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number for all joints, a list with one number for each, or a table by joint name")
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<PerJoint, E> {
        Ok(PerJoint::All(value))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<PerJoint, E> {
        Ok(PerJoint::All(value as f64))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<PerJoint, E> {
        Ok(PerJoint::All(value as f64))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<PerJoint, A::Error> {
        let mut values = Vec::new();
        while let Some(value) = items.next_element()? {
            values.push(value);
        }
        Ok(PerJoint::Each(values))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<PerJoint, A::Error> {
        let mut values = BTreeMap::new();
        while let Some((name, value)) = entries.next_entry()? {
            values.insert(name, value);
        }
        Ok(PerJoint::Named(values))
    }
}
