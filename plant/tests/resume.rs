//! A plant that goes on from a published state does what its forerunner would have done, to the last bit: what the integrator
//! remembers from one sub-step to the next, and of pairs of shapes that are apart, never shows.
#![allow(clippy::unwrap_used)]

use hapfic_config::Settings;
use hapfic_messages::{Command, MAX_JOINTS, Mode, State};
use hapfic_plant::Plant;

fn plant(scenario: &str) -> Plant {
    Plant::new(&Settings::load(scenario, &[]).unwrap()).unwrap()
}

/// Lets the leg fall, and a little torque play on it.
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
    numbers.chain([&state.physics.contact_work_j]).map(|v| v.to_bits()).collect()
}

#[test]
fn a_successor_goes_on_as_its_forerunner_would_have() {
    for scenario in ["floor", "box", "ball"] {
        let mut first = plant(scenario);
        let (mut touched, mut in_the_air) = (0, 0);
        for tick in 0..900 {
            let before = first.sample();
            let state = drive(&mut first, tick);
            let mut bodies = state.contacts[..state.contact_count as usize].iter().map(|c| &first.body_names()[c.body as usize]);
            let leg = bodies.any(|name| name != scenario);
            (touched, in_the_air) = (touched + u32::from(leg), in_the_air + u32::from(!leg));
            // Not every tick: a successor is built from nothing.
            if tick % 60 == 7 && tick > 0 {
                let mut successor = plant(scenario);
                successor.resume(&before).unwrap();
                let mut other = first.clone();
                let mut states = (drive(&mut successor, tick), state);
                for next in tick + 1..tick + 20 {
                    assert_eq!(bits(&states.0), bits(&states.1), "{scenario}, from tick {tick}, at {next}");
                    states = (drive(&mut successor, next), drive(&mut other, next));
                }
            }
        }
        assert!(touched > 50, "{scenario}: {touched} ticks with contact, {in_the_air} without");
    }
}
