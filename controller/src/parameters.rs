//! Conversion of checked settings into the parameter set of the messages.

use hapfic_config::{ParameterSettings, ResetPolicy, Saturation, Search};
use hapfic_messages::Parameters;

/// Returns the parameter set of a version that applies from `effective_tick` on.
///
/// `default_target` is the target if the settings have none [m].
#[must_use]
pub fn parameters(settings: &ParameterSettings, version: u64, effective_tick: i64, default_target: [f64; 3]) -> Parameters {
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
        target_position: settings.target_position.unwrap_or(default_target),
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
        let p = parameters(&settings.initial, 1, 0, [7.0, 8.0, 9.0]);
        assert_eq!(p.check(), Ok(()));
        assert_eq!(p.search, hapfic_messages::Search::Sign.code());
        assert_eq!(p.reset_policy, hapfic_messages::ResetPolicy::AsPrinted.code());
        assert_eq!(p.saturation, hapfic_messages::Saturation::AsPrinted.code());
        assert_eq!((p.offset_anti_windup, p.stall_release), (0, 0));
        assert_eq!(p.stiffness, [1.0, 2.0, 3.0]);
        assert_eq!(p.target_position, [7.0, 8.0, 9.0]);
    }
}
