//! Conversion of checked settings into the parameter set of the messages.

use hapfic_config::{ParameterSettings, ResetPolicy, Saturation, Search};
use hapfic_messages::{JointSpaceParameters, Parameters, RotationParameters, Task};
use hapfic_robot::Kinematics;
use nalgebra::Rotation3;

/// Pose of the tip, world frame: the target where the settings have none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TipPose {
    /// Position [m].
    pub position: [f64; 3],
    /// Roll, pitch, yaw about the fixed axes [rad].
    pub rpy: [f64; 3],
}

impl TipPose {
    /// Pose of a robot's tip.
    #[must_use]
    pub fn of(kin: &Kinematics) -> Self {
        let (roll, pitch, yaw) = Rotation3::from_matrix_unchecked(kin.tip_rotation()).euler_angles();
        Self { position: kin.tip_position().into(), rpy: [roll, pitch, yaw] }
    }
}

/// Returns the parameter set of a version that applies from `effective_tick` on.
///
/// `start` is the target of the parts for which the settings have none.
#[must_use]
pub fn parameters(settings: &ParameterSettings, version: u64, effective_tick: i64, start: &TipPose) -> Parameters {
    let rotation = settings.rotation.map(|r| RotationParameters {
        target_rpy: r.target_orientation.unwrap_or(start.rpy),
        desired_moment: r.desired_moment,
        stiffness: r.rotation_stiffness,
        max_moment: r.max_moment,
        bound: r.rotation_bound,
        damping: r.rotation_damping,
        moment_resolution: r.moment_resolution,
        mean_speed: r.mean_turn_speed,
        max_acceleration: r.max_turn_acceleration,
    });
    let joint_space = JointSpaceParameters {
        posture: settings.joint_space.posture,
        stiffness: settings.joint_space.stiffness,
        damping: settings.joint_space.damping,
        joint_damping: settings.joint_space.joint_damping,
        limit_margin: settings.joint_space.limit_margin,
        limit_stiffness: settings.joint_space.limit_stiffness,
    };
    let task = if rotation.is_some() { Task::Pose } else { Task::Position };
    let reset_policy = match settings.reset_policy {
        ResetPolicy::ContactLoss => hapfic_messages::ResetPolicy::ContactLoss,
        ResetPolicy::AsPrinted => hapfic_messages::ResetPolicy::AsPrinted,
        ResetPolicy::Never => hapfic_messages::ResetPolicy::Never,
    };
    let saturation = match settings.saturation {
        Saturation::Continuous => hapfic_messages::Saturation::Continuous,
        Saturation::AsPrinted => hapfic_messages::Saturation::AsPrinted,
        Saturation::Softening => hapfic_messages::Saturation::Softening,
    };
    let search = match settings.search {
        Search::Tapered => hapfic_messages::Search::Tapered,
        Search::Sign => hapfic_messages::Search::Sign,
        Search::Adaptive => hapfic_messages::Search::Adaptive,
    };
    Parameters {
        version,
        effective_tick,
        target_position: settings.target_position.unwrap_or(start.position),
        desired_force: settings.desired_force,
        stiffness: settings.stiffness,
        max_force: settings.max_force,
        position_bound: settings.position_bound,
        reset_policy: reset_policy.code(),
        saturation: saturation.code(),
        search: search.code(),
        gravity_compensation: u32::from(settings.gravity_compensation),
        offset_anti_windup: u32::from(settings.offset_anti_windup),
        stall_release: u32::from(settings.stall_release),
        force_hold: u32::from(settings.force_hold),
        continuous_reentry: u32::from(settings.continuous_reentry),
        damping: settings.damping,
        posture_lead: settings.posture_lead,
        taper: settings.taper,
        search_scale: settings.search_scale,
        force_resolution: settings.force_resolution,
        mean_speed: settings.mean_speed,
        max_acceleration: settings.max_acceleration,
        task: task.code(),
        joints: settings.joint_space.joints,
        rotation: rotation.unwrap_or_default(),
        joint_space,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_messages::Check;

    #[test]
    fn parameters_from_scenario_pass_check() {
        let overrides = ["controller.fidelity=paper".to_owned(), "controller.stiffness=[1, 2, 3]".to_owned()];
        let settings = hapfic_config::Settings::load("floor", &overrides).unwrap();
        let start = TipPose { position: [7.0, 8.0, 9.0], rpy: [0.0; 3] };
        let p = parameters(&settings.initial, 1, 0, &start);
        assert_eq!(p.check(), Ok(()));
        assert_eq!(p.search, hapfic_messages::Search::Sign.code());
        assert_eq!(p.reset_policy, hapfic_messages::ResetPolicy::AsPrinted.code());
        assert_eq!(p.saturation, hapfic_messages::Saturation::AsPrinted.code());
        assert_eq!((p.offset_anti_windup, p.stall_release), (0, 0));
        assert_eq!(p.stiffness, [1.0, 2.0, 3.0]);
        assert_eq!(p.target_position, [7.0, 8.0, 9.0]);
    }
}
