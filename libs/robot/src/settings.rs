//! The limb of a scenario.

use crate::chain::Chain;
use crate::error::RobotError;
use hapfic_config::Robot;

impl Chain {
    /// The limb a scenario asks for: read from its URDF, placed where its base stands, with the scenario's joint damping and
    /// effort limits where it gives them.
    ///
    /// # Errors
    /// What [`Chain::from_urdf`] refuses, and [`RobotError::PerJoint`] if a list has another length than the limb has joints.
    pub fn from_settings(robot: &Robot) -> Result<Self, RobotError> {
        let mut chain = Self::from_urdf(&robot.urdf.text, &robot.urdf.name, &robot.base_link, &robot.tip_link)?
            .with_base(robot.base_position_m, robot.base_orientation_rpy_rad);
        let dof = chain.dof();
        let fits = |key: &'static str, list: &Vec<f64>| {
            if list.len() == dof { Ok(()) } else { Err(RobotError::PerJoint { key, found: list.len(), joints: dof }) }
        };
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
