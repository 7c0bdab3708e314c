//! Resuming from a published state: a successor computes the same bits as its predecessor would have.
//!
//! The integrator's caches, the warm start and the pairs known to be apart, thus never change a result.
#![allow(clippy::unwrap_used)]

use hapfic_config::Settings;
use hapfic_messages::{Command, MAX_JOINTS, Mode, State};
use hapfic_plant::Plant;

fn plant(scenario: &str) -> Plant {
    Plant::new(&Settings::load(scenario, &[]).unwrap()).unwrap()
}

/// Advances a falling leg by a tick under a small, varying torque.
fn drive(plant: &mut Plant, tick: i64) -> State {
    let mut torque = [0.0; MAX_JOINTS];
    for (i, torque) in torque.iter_mut().enumerate().take(3) {
        *torque = 1.5 * (tick as f64 * 0.013 * (i + 1) as f64).sin();
    }
    plant.take(&Command { tick: tick - 1, mode: Mode::Active.code(), joints: 3, torque, ..Command::default() });
    plant.advance().unwrap();
    plant.sample()
}

fn bits(state: &State) -> Vec<u64> {
    let objects = state.objects.iter().flat_map(|o| o.position.iter().chain(&o.orientation).chain(&o.angular_velocity));
    let numbers = state.joint_position.iter().chain(&state.joint_velocity).chain(&state.foot_force).chain(objects);
    let physics = &state.physics;
    let energies = [
        &physics.contact_work_j,
        &physics.contact_stored_j,
        &physics.joint_work_j,
        &physics.joint_loss_j,
        &physics.energy_error_j,
    ];
    numbers.chain(energies).map(|v| v.to_bits()).collect()
}

#[test]
fn successor_resumed_matches_predecessor_bits() {
    for scenario in ["floor", "box", "ball"] {
        let mut first = plant(scenario);
        let (mut contact_ticks, mut free_ticks) = (0, 0);
        for tick in 0..900 {
            let before = first.sample();
            let state = drive(&mut first, tick);
            let mut bodies = state.contacts[..state.contact_count as usize].iter().map(|c| &first.body_names()[c.body as usize]);
            let leg = bodies.any(|name| name != scenario);
            (contact_ticks, free_ticks) = (contact_ticks + u32::from(leg), free_ticks + u32::from(!leg));
            // Not every tick: building a successor is slow.
            if tick % 60 == 7 && tick > 0 {
                let mut successor = plant(scenario);
                successor.resume(&before, None).unwrap();
                let mut other = first.clone();
                let mut states = (drive(&mut successor, tick), state);
                for next in tick + 1..tick + 20 {
                    assert_eq!(bits(&states.0), bits(&states.1), "{scenario}, from tick {tick}, at {next}");
                    states = (drive(&mut successor, next), drive(&mut other, next));
                }
            }
        }
        assert!(contact_ticks > 50, "{scenario}: {contact_ticks} ticks with contact, {free_ticks} without");
    }
}

#[test]
fn successor_resumed_among_cut_substeps_matches_predecessor_bits() {
    let build = || {
        let text = include_str!("scenes/plate_drop.toml");
        Plant::new(&Settings::from_effective(text, "leg.urdf", hapfic_config::robots()[0].1).unwrap()).unwrap()
    };
    let mut first = build();
    let mut cut = 0;
    for tick in 0..2080 {
        let before = first.sample();
        first.advance().unwrap();
        let state = first.sample();
        cut += state.physics.cut_substeps;
        if tick > 2010 {
            let mut successor = build();
            successor.resume(&before, None).unwrap();
            successor.advance().unwrap();
            assert_eq!(bits(&successor.sample()), bits(&state), "from tick {tick}");
        }
    }
    assert!(cut > 0, "no sub-step was cut");
}
