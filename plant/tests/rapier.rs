//! The engine rapier: forces, friction and rest as the same scenes of the plant's own engine have them.
#![allow(clippy::unwrap_used, missing_docs)]

use hapfic_config::Settings;
use hapfic_messages::{Command, MAX_JOINTS, Mode, State};
use hapfic_plant::{Plant, PlantError};

const RAPIER: [&str; 2] = ["plant.engine=\"rapier\"", "plant.softness={ frequency_hz = 100.0, damping_ratio = 1.0 }"];

fn settings(scenario: &str, more: &[&str]) -> Settings {
    let changes: Vec<String> = RAPIER.iter().chain(more).map(|change| (*change).to_owned()).collect();
    Settings::load(scenario, &changes).unwrap()
}

fn drive(plant: &mut Plant, tick: i64, torque: [f64; MAX_JOINTS]) -> Result<State, PlantError> {
    let command = Command { tick: tick - 1, mode: Mode::Active.code(), torque, ..Command::default() };
    plant.take(&command);
    plant.advance()?;
    Ok(plant.sample())
}

/// Joint torque that pushes the foot with a force against the world.
fn push(plant: &Plant, force: [f64; 3]) -> [f64; MAX_JOINTS] {
    let state = plant.sample();
    let gravity = nalgebra::Vector3::new(0.0, 0.0, -9.81);
    plant.chain().tip_force_torque(&state.joint_position, &force.into(), Some(&gravity))
}

#[test]
fn foot_pressed_on_the_floor_feels_the_force() {
    let mut plant = Plant::new(&settings("floor", &["robot.joint_damping_n_m_s_per_rad=5.0"])).unwrap();
    let mut state = plant.sample();
    for tick in 0..3000 {
        let torque = push(&plant, [0.0, 0.0, -50.0]);
        state = drive(&mut plant, tick, torque).unwrap();
    }
    let [x, y, z] = state.foot_force;
    // Frictionless: nothing across the normal.
    assert!((z - 50.0).abs() < 0.05 && x.abs() < 0.05 && y.abs() < 0.05, "{:?}", state.foot_force);
    assert_eq!(state.contact_count, 1);
    assert!(state.contacts[0].depth > 0.0 && (state.contacts[0].force[2] - z).abs() < 1e-9);
}

#[test]
fn friction_acts_against_the_slip() {
    let rough = ["world.floor.friction_static=0.5", "world.floor.friction_dynamic=0.5", "robot.joint_damping_n_m_s_per_rad=20.0"];
    let mut plant = Plant::new(&settings("floor", &rough)).unwrap();
    let mut forces = Vec::new();
    for tick in 0..3000 {
        let along = if tick > 2000 { 60.0 } else { 0.0 };
        let torque = push(&plant, [along, 0.0, -50.0]);
        let state = drive(&mut plant, tick, torque).unwrap();
        if tick > 2010 && state.foot_velocity[0] > 0.02 && state.foot_force[2] > 20.0 {
            forces.push(state.foot_force);
        }
    }
    assert!(forces.len() > 20, "the foot does not slide");
    for [x, _, z] in forces {
        assert!(x < 0.0 && (x / z + 0.5).abs() < 0.1, "{x} {z}");
    }
}

#[test]
fn box_rests_with_its_weight() {
    let mut plant = Plant::new(&settings("box", &[])).unwrap();
    let start = plant.sample().objects[0];
    for _ in 0..2000 {
        plant.advance().unwrap();
    }
    let state = plant.sample();
    let floor = plant.body_names().iter().position(|name| name == "floor").unwrap() as u32;
    let weight: f64 =
        state.contacts[..state.contact_count as usize].iter().filter(|c| c.against == floor).map(|c| c.force[2]).sum();
    let mass = hapfic_config::Settings::load("box", &[]).unwrap().world.objects[0].mass_kg;
    assert!((weight - mass * 9.81).abs() < 0.01 * mass * 9.81, "{weight}");
    assert!((0..2).all(|i| (state.objects[0].position[i] - start.position[i]).abs() < 1e-3), "{:?}", state.objects[0]);
    // The brakes hold the leg exactly.
    assert_eq!(state.joint_velocity, [0.0; MAX_JOINTS]);
    assert_eq!(state.joint_position, Plant::new(&settings("box", &[])).unwrap().sample().joint_position);
}

#[test]
fn same_motion_twice_and_in_a_copy() {
    let run = |mut plant: Plant, from: i64| {
        (from..from + 400)
            .map(|tick| {
                let torque = push(&plant, [5.0, 0.0, -30.0]);
                drive(&mut plant, tick, torque).unwrap()
            })
            .last()
    };
    let build = || Plant::new(&settings("ball", &[])).unwrap();
    let first = run(build(), 0);
    assert_eq!(first, run(build(), 0));
    let mut plant = build();
    for tick in 0..400 {
        let torque = push(&plant, [5.0, 0.0, -30.0]);
        drive(&mut plant, tick, torque).unwrap();
    }
    assert_eq!(run(plant.clone(), 400), run(plant, 400));
}

#[test]
fn successor_continues_to_the_bit() {
    let build = || Plant::new(&settings("box", &[])).unwrap();
    let mut plant = build();
    for tick in 0..500 {
        let torque = push(&plant, [5.0, 0.0, -30.0]);
        drive(&mut plant, tick, torque).unwrap();
    }
    let (state, memory) = (plant.sample(), plant.memory().unwrap());
    let mut successor = build();
    assert!(matches!(successor.resume(&state, None), Err(PlantError::Memory)));
    assert!(matches!(successor.resume(&state, Some(&memory[..memory.len() / 2])), Err(PlantError::Memory)));
    successor.resume(&state, Some(&memory)).unwrap();
    for tick in 500..900 {
        let torque = push(&plant, [5.0, 0.0, -30.0]);
        assert_eq!(push(&successor, [5.0, 0.0, -30.0]), torque);
        let expected = drive(&mut plant, tick, torque).unwrap();
        assert_eq!(drive(&mut successor, tick, torque).unwrap(), expected, "tick {tick}");
    }
}

#[test]
fn what_rapier_cannot_represent_is_refused() {
    let refused = |changes: &[&str]| {
        let changes: Vec<String> = changes.iter().map(|change| (*change).to_owned()).collect();
        Settings::load("floor", &changes).unwrap_err().to_string()
    };
    let text = refused(&RAPIER[..1]);
    assert!(text.contains("plant.engine") && text.contains("stiffness_n_per_m") && text.contains("plant.softness ="), "{text}");
    let text = refused(&RAPIER[1..]);
    assert!(text.contains("plant.softness") && text.contains("hapfic"), "{text}");
    let text = refused(&[RAPIER[0], "plant.softness={ frequency_hz = 0.0, damping_ratio = 1.0 }"]);
    assert!(text.contains("plant.softness.frequency_hz"), "{text}");
}
