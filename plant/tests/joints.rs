//! Friction and rotors of the joints, and the moment sensor.

#![allow(clippy::unwrap_used)]

use hapfic_config::Settings;
use hapfic_messages::MAX_JOINTS;
use hapfic_plant::{DriveAction, Plant};

fn plant(overrides: &[&str]) -> Plant {
    let mut all = vec!["world.gravity_m_per_s2=[0, 0, 0]".to_owned(), "robot.base_position_m=[0, 0, 2]".to_owned()];
    all.extend(overrides.iter().map(|o| (*o).to_owned()));
    Plant::new(&Settings::load("floor", &all).unwrap()).unwrap()
}

fn knee(torque: f64) -> DriveAction {
    let mut all = [0.0; MAX_JOINTS];
    all[2] = torque;
    DriveAction::Torque(all)
}

#[test]
fn friction_holds_below_its_value_and_resists_above() {
    let mut plant = plant(&["robot.joint_friction_n_m=0.5"]);
    for _ in 0..500 {
        plant.world().advance(knee(0.4), 1000);
    }
    let creep = plant.world().qd[2];
    // f q' / (|q'| + v_c) = 0.4 at q' = 4 v_c.
    assert!((creep - 4e-3).abs() < 1e-4, "{creep} rad/s");
    let speed = |friction: &str, torque: f64| {
        let mut plant = self::plant(&[&format!("robot.joint_friction_n_m={friction}"), "robot.armature_kg_m2=[10, 10, 0]"]);
        for _ in 0..50 {
            plant.world().advance(knee(torque), 1000);
        }
        plant.world().qd[2]
    };
    let ratio = speed("0.5", 1.5) / speed("0", 1.0);
    assert!((ratio - 1.0).abs() < 0.02, "1.5 N m against 0.5 N m of friction moves like 1 N m: {ratio}");
}

#[test]
fn friction_takes_energy_and_the_balance_holds() {
    let mut plant = plant(&["robot.joint_friction_n_m={ kfe = 0.3 }", "plant.contact_substep_us=20"]);
    plant.world().qd[2] = 2.0;
    let start = plant.world().energy();
    let mut error = 0.0_f64;
    for _ in 0..1000 {
        let result = plant.world().advance(knee(0.0), 1000);
        error = error.max(result.physics.energy_error_j.abs());
    }
    let end = plant.world().energy();
    assert!(end < 0.9 * start, "{end} of {start} J");
    assert!(error < 1e-5 * start, "balance off by {error} of {start} J");
}

#[test]
fn armature_adds_to_the_inertia_of_its_joint() {
    let acceleration = |armature: &str| {
        let mut plant = plant(&[&format!("robot.armature_kg_m2=[100, 100, {armature}]")]);
        plant.world().advance(knee(1.0), 1000);
        plant.world().qd[2] / 1e-3
    };
    let bare = 1.0 / acceleration("0");
    let with = 1.0 / acceleration("0.05");
    assert!((with - bare - 0.05).abs() < 1e-3, "{bare} and {with} kg m^2");
}

#[test]
fn moment_sensor_measures_friction_about_the_tip() {
    let overrides = ["world.floor.friction_static=0.5", "world.floor.friction_dynamic=0.5"].map(str::to_owned);
    let settings = Settings::load("floor", &overrides).unwrap();
    let mut simulation = falling(&settings);
    let mut seen = 0;
    for _ in 0..6000 {
        simulation.advance().unwrap();
        let state = simulation.sample();
        let [fx, fy, fz] = state.foot_force;
        if fz > 5.0 {
            // The floor's force acts a ball's radius below the tip.
            let expected = [0.02 * fy, -0.02 * fx];
            let depth = 1e-3 * (fx.abs() + fy.abs()) + 1e-3;
            assert!((state.foot_moment[0] - expected[0]).abs() < depth, "{:?} of {:?}", state.foot_moment, state.foot_force);
            assert!((state.foot_moment[1] - expected[1]).abs() < depth, "{:?} of {:?}", state.foot_moment, state.foot_force);
            assert!(state.foot_moment[2].abs() < 1e-9);
            seen += 1;
        }
    }
    assert!(seen > 100, "{seen} ticks in contact");
}

/// The leg falls onto the floor and slides, without a controller.
fn falling(settings: &Settings) -> Plant {
    use hapfic_messages::{Command, Mode};
    let mut plant = Plant::new(settings).unwrap();
    let mut torque = [0.0; MAX_JOINTS];
    (torque[1], torque[2]) = (3.0, 1.0);
    plant.take(&Command { tick: 0, mode: Mode::Active.code(), joints: 3, torque, ..Command::default() });
    plant
}
