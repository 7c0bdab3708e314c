//! Conversion of a published parameter set into the settings that made it.

use hapfic_config::{JointSpaceSettings, ParameterSettings, ResetPolicy, RotationSettings, Saturation, Search};
use hapfic_messages::Parameters;

/// Settings of a published set; `None` if a code is invalid, which the check of messages excludes.
#[must_use]
pub fn settings(set: &Parameters) -> Option<ParameterSettings> {
    Some(ParameterSettings {
        target_position: Some(set.target_position),
        desired_force: set.desired_force,
        stiffness: set.stiffness,
        max_force: set.max_force,
        position_bound: set.position_bound,
        reset_policy: match hapfic_messages::ResetPolicy::from_code(set.reset_policy)? {
            hapfic_messages::ResetPolicy::ContactLoss => ResetPolicy::ContactLoss,
            hapfic_messages::ResetPolicy::AsPrinted => ResetPolicy::AsPrinted,
            hapfic_messages::ResetPolicy::Never => ResetPolicy::Never,
        },
        saturation: match hapfic_messages::Saturation::from_code(set.saturation)? {
            hapfic_messages::Saturation::Continuous => Saturation::Continuous,
            hapfic_messages::Saturation::AsPrinted => Saturation::AsPrinted,
            hapfic_messages::Saturation::Softening => Saturation::Softening,
        },
        search: match hapfic_messages::Search::from_code(set.search)? {
            hapfic_messages::Search::Tapered => Search::Tapered,
            hapfic_messages::Search::Sign => Search::Sign,
            hapfic_messages::Search::Adaptive => Search::Adaptive,
        },
        taper: set.taper,
        search_scale: set.search_scale,
        force_resolution: set.force_resolution,
        gravity_compensation: set.gravity_compensation != 0,
        offset_anti_windup: set.offset_anti_windup != 0,
        stall_release: set.stall_release != 0,
        force_hold: set.force_hold != 0,
        continuous_reentry: set.continuous_reentry != 0,
        damping: set.damping,
        posture_lead: set.posture_lead,
        mean_speed: set.mean_speed,
        max_acceleration: set.max_acceleration,
        rotation: set.is_pose().then_some(RotationSettings {
            target_orientation: Some(set.rotation.target_rpy),
            desired_moment: set.rotation.desired_moment,
            rotation_stiffness: set.rotation.stiffness,
            max_moment: set.rotation.max_moment,
            rotation_bound: set.rotation.bound,
            rotation_damping: set.rotation.damping,
            moment_resolution: set.rotation.moment_resolution,
            mean_turn_speed: set.rotation.mean_speed,
            max_turn_acceleration: set.rotation.max_acceleration,
        }),
        joint_space: JointSpaceSettings {
            posture: set.joint_space.posture,
            joints: set.joints,
            stiffness: set.joint_space.stiffness,
            damping: set.joint_space.damping,
            joint_damping: set.joint_space.joint_damping,
            limit_margin: set.joint_space.limit_margin,
            limit_stiffness: set.joint_space.limit_stiffness,
        },
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::parameter_schedule::ParameterSchedule;
    use hapfic_config::Settings;
    use hapfic_controller::parameters::TipPose;

    #[test]
    fn settings_of_published_set_are_those_that_made_it() {
        let overrides = [
            "controller.search=sign",
            "controller.reset_policy=never",
            "controller.saturation=as_printed",
            "controller.stall_release=false",
            "controller.taper=0.123",
            "planner.mean_speed=0.3",
        ];
        let made = Settings::load("floor", &overrides.map(str::to_owned)).unwrap();
        let published = *ParameterSchedule::new(&made, TipPose { position: [0.1, 0.2, 0.3], rpy: [0.0; 3] }).operator();
        let expected = ParameterSettings { target_position: Some([0.1, 0.2, 0.3]), ..made.initial };
        assert_eq!(settings(&published.current), Some(expected));
    }
}
