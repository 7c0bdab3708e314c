//! The chain of a scenario.

use crate::chain::Chain;
use crate::error::RobotError;
use hapfic_config::RobotSettings;

impl Chain {
    /// Builds the chain of a scenario: its URDF and base pose, with its joint damping and effort limits, if any.
    ///
    /// # Errors
    /// Those of [`Chain::from_urdf`], and [`RobotError::PerJoint`] if a list has another length than the chain has
    /// joints. The start posture comes first: a single number for all joints is expanded to its length.
    pub fn from_settings(robot: &RobotSettings) -> Result<Self, RobotError> {
        let mut chain = Self::from_urdf(&robot.urdf.text, &robot.urdf.name, &robot.base_link, &robot.tip_link)?
            .with_base(robot.base_position_m, robot.base_orientation_rpy_rad);
        let dof = chain.dof();
        let (base, tip) = (robot.base_link.as_str(), robot.tip_link.as_str());
        let fits = |key: &'static str, list: &Vec<f64>| {
            let error =
                || RobotError::PerJoint { key, found: list.len(), joints: dof, base: base.to_owned(), tip: tip.to_owned() };
            if list.len() == dof { Ok(()) } else { Err(error()) }
        };
        fits("robot.start_position_rad", &robot.start_position)?;
        if let Some(list) = &robot.joint_damping {
            fits("robot.joint_damping_n_m_s_per_rad", list)?;
            for (joint, value) in chain.joints.iter_mut().zip(list) {
                joint.damping = *value;
            }
        }
        if let Some(list) = &robot.effort_limit {
            fits("robot.effort_limit_n_m", list)?;
            for (joint, value) in chain.joints.iter_mut().zip(list) {
                joint.effort = *value;
            }
        }
        Ok(chain)
    }
}
