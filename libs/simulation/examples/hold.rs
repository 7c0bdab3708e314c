//! Simulates a scenario in which the tip presses, pushes the tip in the middle, and prints what became of it as JSON.
//!
//! `hold SCENARIO`: the force along z of the last operator's entry is the one to be held. The first sixth is for settling, the
//! push of 1 N s along y comes after the half, and the last second must be at rest.
#![allow(clippy::print_stdout, clippy::print_stderr)]

use hapfic_config::Settings;
use hapfic_robot::Chain;
use hapfic_simulation::Simulation;
use nalgebra::Vector3;
use serde_json::json;
use std::path::Path;

/// Impulse [N s].
const PUSH_N_S: f64 = 1.0;
/// Ticks at the end that must be at rest.
const LAST: i64 = 1000;

fn main() -> anyhow::Result<()> {
    let file = std::env::args().nth(1).ok_or_else(|| anyhow::anyhow!("usage: hold SCENARIO"))?;
    let settings = Settings::load(Path::new(&file).to_str().unwrap_or_default(), &[])?;
    let chain = Chain::from_settings(&settings.robot)?;
    let n = chain.dof();
    let force =
        settings.operator.iter().rev().find_map(|change| change.desired_force).unwrap_or(settings.initial.desired_force)[2];
    let end = settings.duration_ticks as i64;
    let (settled, pushed) = (end / 6, end / 2);
    let mut simulation = Simulation::new(&settings)?;
    let (mut squares, mut count, mut turned, mut speed, mut drift) = (0.0, 0, 0.0_f64, 0.0_f64, 0.0_f64);
    let (mut at_stop, mut farthest) = (false, 0.0_f64);
    let mut start: Option<[f64; 16]> = None;
    let mut held = [0.0; 16];
    for tick in 0..end {
        if tick == pushed {
            held = simulation.snapshot().state.joint_position;
            simulation.push_tip(&Vector3::new(0.0, PUSH_N_S, 0.0));
        }
        let snapshot = *simulation.step()?;
        let state = &snapshot.state;
        let apart = |from: &[f64; 16]| (0..n).map(|i| (from[i] - state.joint_position[i]).abs()).fold(0.0, f64::max);
        at_stop |= chain.joints().iter().zip(&state.joint_position).any(|(joint, q)| *q <= joint.lower || *q >= joint.upper);
        if (settled..pushed).contains(&tick) || tick >= end - LAST {
            squares += (state.foot_force[2] - force).powi(2);
            count += 1;
            turned = Vector3::from(snapshot.command.request.rotation.error).norm().max(turned);
        }
        if (settled..pushed).contains(&tick) {
            drift = drift.max(apart(start.get_or_insert(state.joint_position)));
        }
        if tick >= pushed {
            farthest = farthest.max(apart(&held));
        }
        if tick >= end - LAST {
            speed = state.joint_velocity[..n].iter().fold(speed, |most, rate| most.max(rate.abs()));
        }
    }
    let now = simulation.snapshot().state.joint_position;
    let moved = (0..n).map(|i| (held[i] - now[i]).abs()).fold(0.0, f64::max);
    println!(
        "{}",
        json!({
            "joints": n,
            "settled_percent": 100.0 * (squares / f64::from(count)).sqrt() / force,
            "turned_degrees": turned.to_degrees(),
            "drift_rad": drift,
            "pushed_rad": farthest,
            "returned_rad": moved,
            "speed_rad_per_s": speed,
            "at_stop": at_stop,
        })
    );
    Ok(())
}
