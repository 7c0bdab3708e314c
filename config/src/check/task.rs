//! The task: axes of rotation and the law in joint space, with the defaults that depend on the number of joints.

use super::ScenarioCheck;
use crate::error::ConfigError;
use crate::parameters::{JointSpaceSettings, OperatorChange, RotationSettings};
use crate::policy::Task;
use crate::raw::{RawController, RawPlanner, RawScenario};
use crate::settings::MAX_JOINTS;

/// Joints above which a robot is an arm: its weight is compensated, its posture held, and its joints kept from their limits.
pub(super) const ARM_JOINTS: usize = 3;

/// Axes of a pose.
const POSE_AXES: usize = 6;

/// Parameters of the axes of rotation, written into the raw sections; `None` in a position task.
pub(super) fn rotation(controller: &mut RawController, planner: &mut RawPlanner) -> Option<RotationSettings> {
    (controller.task == Task::Pose).then(|| RotationSettings {
        target_orientation: None,
        desired_moment: [0.0; 3],
        rotation_stiffness: *controller.rotation_stiffness_n_m_per_rad.get_or_insert([30.0; 3]),
        max_moment: *controller.max_moment_n_m.get_or_insert([10.0; 3]),
        rotation_bound: *controller.rotation_bound_rad.get_or_insert([0.3; 3]),
        rotation_damping: *controller.rotation_damping_sqrt_kg_m.get_or_insert(0.05),
        moment_resolution: *controller.moment_resolution_n_m.get_or_insert(0.01),
        mean_turn_speed: *planner.mean_turn_speed_rad_per_s.get_or_insert(0.5),
        max_turn_acceleration: *planner.max_turn_acceleration_rad_per_s2.get_or_insert(10.0),
    })
}

impl ScenarioCheck<'_> {
    /// Rejects a pose task without the joints for it, and keys of the rotation in a position task.
    pub(super) fn rotation_keys(&self, raw: &RawScenario, operator: &[OperatorChange]) -> Result<(), ConfigError> {
        let joints = raw.robot.start_position_rad.len();
        if raw.controller.task == Task::Pose {
            if joints >= POSE_AXES {
                return Ok(());
            }
            let found = format!("\"pose\" with {joints} joints");
            let help = "use task = \"position\"; the orientation then follows from the position";
            return Err(ConfigError::Combination(self.diagnostic("controller.task", &found, "at least 6 joints", help)));
        }
        let (c, p) = (&raw.controller, &raw.planner);
        let given = [
            (c.rotation_stiffness_n_m_per_rad.is_some(), "controller.rotation_stiffness_n_m_per_rad"),
            (c.max_moment_n_m.is_some(), "controller.max_moment_n_m"),
            (c.rotation_bound_rad.is_some(), "controller.rotation_bound_rad"),
            (c.rotation_damping_sqrt_kg_m.is_some(), "controller.rotation_damping_sqrt_kg_m"),
            (c.moment_resolution_n_m.is_some(), "controller.moment_resolution_n_m"),
            (p.mean_turn_speed_rad_per_s.is_some(), "planner.mean_turn_speed_rad_per_s"),
            (p.max_turn_acceleration_rad_per_s2.is_some(), "planner.max_turn_acceleration_rad_per_s2"),
        ];
        let key = given.into_iter().find_map(|(given, key)| given.then(|| key.to_owned()));
        let entry = || {
            let found = operator.iter().enumerate().find_map(|(index, change)| Some((index, change.rotation_key()?)));
            found.map(|(index, key)| format!("operator[{index}].{key}"))
        };
        let Some(key) = key.or_else(entry) else { return Ok(()) };
        let found = format!("{} in a position task", self.found(&key));
        let help = "add task = \"pose\" to [controller], or remove the key";
        Err(ConfigError::Combination(self.diagnostic(&key, &found, "a pose task", help)))
    }

    /// The law in joint space, with its defaults written into the raw section.
    pub(super) fn joint_space(&self, raw: &mut RawController, start: &[f64]) -> Result<JointSpaceSettings, ConfigError> {
        const KEY: &str = "controller.posture_rad";
        let joints = start.len();
        let arm = joints > ARM_JOINTS;
        let or_for_arm = |value: &mut Option<f64>, default: f64| *value.get_or_insert(if arm { default } else { 0.0 });
        let desired = match raw.posture_rad.clone() {
            Some(posture) => posture.expand(joints).ok_or_else(|| self.no_table(KEY))?,
            None => start.to_vec(),
        };
        if desired.len() != joints {
            let found = format!("a list of {}", desired.len());
            let expected = format!("a number for all joints, or a list of {joints}, as robot.start_position_rad has");
            let help = "correct the list that has another length than the robot has joints";
            return Err(ConfigError::WrongLength(self.diagnostic(KEY, &found, &expected, help)));
        }
        let mut posture = [0.0; MAX_JOINTS];
        posture[..joints].copy_from_slice(&desired);
        Ok(JointSpaceSettings {
            posture,
            joints: joints as u32,
            stiffness: or_for_arm(&mut raw.posture_stiffness_n_m_per_rad, 10.0),
            damping: or_for_arm(&mut raw.posture_damping_n_m_s_per_rad, 4.0),
            joint_damping: raw.joint_damping_n_m_s_per_rad,
            limit_margin: raw.limit_margin_rad,
            limit_stiffness: or_for_arm(&mut raw.limit_stiffness_n_m_per_rad, 100.0),
        })
    }
}
