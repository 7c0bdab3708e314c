//! Values per joint, as written.

use schemars::JsonSchema;
use serde::de::{Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt;

/// One number for all joints, or a list with one number for each.
#[derive(Clone, Debug, JsonSchema, Serialize)]
#[serde(untagged)]
pub(crate) enum PerJoint {
    /// The same number for all joints.
    All(f64),
    /// Numbers in the order of the chain, from base to tip.
    Each(Vec<f64>),
}

impl PerJoint {
    /// Returns a number for each joint: as written, or the one number for all.
    pub(crate) fn expand(self, joints: usize) -> Vec<f64> {
        match self {
            Self::All(number) => vec![number; joints],
            Self::Each(numbers) => numbers,
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
        f.write_str("a number for all joints, or a list with one number for each")
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
}
