//! What a scenario or a description says about the drive of a joint: limits, damping, friction, rotor.

use crate::build::ChainBuilder;
use crate::error::RobotError;
use crate::xml::Element;
use hapfic_config::JointValues;

/// Effort above which a limit is a placeholder [N m or N].
const PLACEHOLDER_EFFORT: f64 = 1e4;

impl ChainBuilder<'_> {
    /// The scenario's value for the joint that comes next, if it has one.
    pub(crate) fn replaced(&self, values: Option<&JointValues>, name: &str) -> Option<f64> {
        match values? {
            JointValues::InOrder(list) => list.get(self.joints.len()).copied(),
            JointValues::ByName(list) => list.iter().find(|(joint, _)| joint == name).map(|(_, value)| *value),
        }
    }

    /// A value of `<dynamics>`, zero or more: the scenario's, else the description's, else zero.
    pub(crate) fn dynamics(
        &self,
        name: &str,
        joint: Element<'_>,
        attribute: &'static str,
        values: Option<&JointValues>,
    ) -> Result<f64, RobotError> {
        if let Some(value) = self.replaced(values, name) {
            return Ok(value);
        }
        let Some(dynamics) = joint.child("dynamics") else { return Ok(0.0) };
        let place = || format!("joint '{name}' <dynamics {attribute}>");
        let value = dynamics.number(attribute, place)?.unwrap_or(0.0);
        dynamics.not_negative(value, place)?;
        Ok(value)
    }

    /// Largest torque of a joint: the scenario's, else the description's.
    pub(crate) fn effort(&mut self, name: &str, joint: Element<'_>, limit: Option<Element<'_>>) -> Result<f64, RobotError> {
        if let Some(value) = self.replaced(self.replacements.effort_limit, name) {
            return Ok(value);
        }
        let place = || format!("joint '{name}' <limit effort>");
        let at = limit.unwrap_or(joint);
        let effort = match limit {
            Some(limit) => limit.number("effort", place)?,
            None => None,
        };
        if let Some(found) = effort {
            at.finite(found, place)?;
        }
        match effort {
            Some(effort) if effort > PLACEHOLDER_EFFORT => {
                self.warn(at, format!("{}: {effort} is a placeholder, expected the peak torque of the drive", place()));
                Ok(effort)
            }
            Some(effort) if effort > 0.0 => Ok(effort),
            found => Err(RobotError::Effort { file: at.place(), joint: name.to_owned(), found }),
        }
    }

    /// Largest speed of a joint: the scenario's, else the description's; infinite if none is given (URDF 1.2), or zero or less, as many files have it.
    pub(crate) fn velocity(&mut self, name: &str, limit: Option<Element<'_>>) -> Result<f64, RobotError> {
        if let Some(value) = self.replaced(self.replacements.velocity_limit, name) {
            return Ok(value);
        }
        let Some(limit) = limit else { return Ok(f64::INFINITY) };
        let place = || format!("joint '{name}' <limit velocity>");
        match limit.number("velocity", place)? {
            None => Ok(f64::INFINITY),
            Some(f64::INFINITY) => Ok(f64::INFINITY),
            // It is watched, not enforced: a placeholder cannot stop a load.
            Some(velocity) if velocity <= 0.0 => {
                self.warn(limit, format!("{}: found {velocity}, taken as no limit", place()));
                Ok(f64::INFINITY)
            }
            Some(velocity) => limit.not_negative(velocity, place).map(|()| velocity),
        }
    }
}
