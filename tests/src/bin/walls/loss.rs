//! Loss of contact: the foot holds a force when the floor goes.

use crate::case::{Case, Condition, LAWS, Law, STEP_TICK};
use hapfic_plant::Plant;
use hapfic_simulation::Simulation;

/// Tick at which the floor goes, with the force settled.
const LOSS_TICK: i64 = STEP_TICK + 1000;
/// Ticks after it.
const FREE_TICKS: i64 = 1000;

/// Table of the loss of contact under 50 and 100 N, with each law.
pub(crate) fn table() -> Result<String, String> {
    let mut text =
        "| F_d, N | law | largest speed, m/s | within, s | way, mm | rests after 1 s |\n|---|---|---|---|---|---|\n".to_owned();
    for force in [50.0, 100.0] {
        for law in LAWS {
            let free = free(law, force)?;
            text.push_str(&format!(
                "| {force} | {} | {:.3} | {:.3} | {:.1} | {} |\n",
                law.name,
                free.speed,
                free.speed_after_s,
                1e3 * free.way_m,
                if free.last_speed < 0.01 { "yes" } else { "no" }
            ));
        }
    }
    Ok(text)
}

/// What the foot does without the floor.
#[derive(Default)]
struct Free {
    /// Largest speed [m/s], and when [s].
    speed: f64,
    speed_after_s: f64,
    /// Largest distance from the place of the loss [m].
    way_m: f64,
    /// Largest speed in the last 0.1 s [m/s].
    last_speed: f64,
}

fn free(law: Law, force: f64) -> Result<Free, String> {
    let failed = |error: &dyn std::fmt::Display| format!("{}, {force} N: {error}", law.name);
    let case = Case { law, stiffness: 1e6, ratio: None, friction: 0.0, force, condition: Condition::Plain };
    let settings = case.settings();
    let mut simulation = Simulation::new(&settings).map_err(|e| failed(&e))?;
    while simulation.tick() < LOSS_TICK {
        simulation.step().map_err(|e| failed(&e))?;
    }
    let at = simulation.plant().sample();
    let mut empty = settings.clone();
    empty.world.floor = None;
    let mut plant = Plant::new(&empty).map_err(|e| failed(&e))?;
    plant.resume(&at, None).map_err(|e| failed(&e))?;
    *simulation.plant() = plant;
    let mut free = Free::default();
    for tick in 0..FREE_TICKS {
        let state = simulation.step().map_err(|e| failed(&e))?.state;
        let speed = norm(state.foot_velocity);
        if speed > free.speed {
            (free.speed, free.speed_after_s) = (speed, tick as f64 * 1e-3);
        }
        free.way_m = free.way_m.max(norm(std::array::from_fn(|i| state.foot_position[i] - at.foot_position[i])));
        if tick >= FREE_TICKS - 100 {
            free.last_speed = free.last_speed.max(speed);
        }
    }
    Ok(free)
}

fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}
