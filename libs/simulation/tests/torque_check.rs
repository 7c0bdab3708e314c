//! The gate's torque check on all requests of the stack.
#![allow(clippy::unwrap_used)]

use hapfic_config::Settings;
use hapfic_gate::TorqueCheck;
use hapfic_messages::ValidationError;
use hapfic_simulation::Simulation;

#[test]
fn torque_check_changed_torque_is_rejected() {
    for scenario in ["floor", "ball-actuators"] {
        let settings = Settings::load(scenario, &["controller.gravity_compensation=true".to_owned()]).unwrap();
        let mut simulation = Simulation::new(&settings).unwrap();
        let chain = simulation.plant().chain().clone();
        let check = TorqueCheck::new(chain, settings.world.gravity_m_per_s2);
        for _ in 0..2500 {
            let made = *simulation.step().unwrap();
            let parameters = made.operator.at(made.state.tick);
            let request = made.command.request;
            assert_eq!(check.check(&made.state, &request, parameters), Ok(()));
            let mut bad = request;
            bad.torque[1] += 1e-3;
            assert!(matches!(check.check(&made.state, &bad, parameters), Err(ValidationError::Torque { joint: 1, .. })));
            let mut bad = request;
            bad.force[2] += 1.0;
            assert!(check.check(&made.state, &bad, parameters).is_err());
        }
    }
}
