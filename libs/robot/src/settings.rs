//! The chain of a scenario.

use crate::build::{Replacements, check_length};
use crate::chain::Chain;
use crate::error::RobotError;
use hapfic_config::RobotSettings;

impl Chain {
    /// Builds the chain of a scenario: its URDF and base pose, with its joint damping, effort limits and foot, if any.
    ///
    /// # Errors
    /// Those of [`Chain::from_urdf`], and [`RobotError::PerJoint`] if a list has another length than the chain has
    /// joints. The start posture comes first: a single number for all joints is expanded to its length.
    pub fn from_settings(robot: &RobotSettings) -> Result<Self, RobotError> {
        let replacements = Replacements {
            joint_damping: robot.joint_damping.as_ref(),
            effort_limit: robot.effort_limit.as_ref(),
            velocity_limit: robot.velocity_limit.as_ref(),
            joint_friction: robot.joint_friction.as_ref(),
            armature: robot.armature.as_ref(),
            foot: robot.foot.as_ref(),
        };
        let (base, tip) = (robot.base_link.as_str(), robot.tip_link.as_str());
        let start = |dof: usize| check_length("robot.start_position_rad", Some(&robot.start_position), dof, base, tip);
        let chain =
            Self::from_urdf_with(&robot.urdf.text, &robot.urdf.name, base, tip, &replacements).map_err(|error| match error {
                RobotError::PerJoint { joints, .. } => start(joints).err().unwrap_or(error),
                _ => error,
            })?;
        start(chain.dof())?;
        Ok(chain.with_base(robot.base_position_m, robot.base_orientation_rpy_rad))
    }
}
