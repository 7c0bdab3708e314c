//! Random leg motion among objects: all numbers stay finite, no body tunnels, and contacts create no energy.
//!
//! `HAPFIC_SEEDS=100` in the environment runs 100 seeds per scenario.

use crate::script;
use crate::workers::for_each_seed;
use crate::worst::Worst;
use hapfic_simulation::{Simulation, SimulationError};

const TICKS: u64 = 10_000;
/// Default number of seeds per scenario.
const SEEDS: u64 = 5;
/// Radius of the foot's sphere about the tip [m].
const FOOT_RADIUS_M: f64 = 0.02;
/// Largest depth of the foot in the floor [m]: twice the transition width.
const FOOT_BELOW_M: f64 = 2e-3;
/// Largest depth of a rigid contact [m]: the leg as a lever presses an object with more than F_max.
const RIGID_M: f64 = 3e-3;
/// Largest rise of work plus stored energy of the contacts [J].
const RISE_J: f64 = 1e-3;
/// Largest share of implicit sub-steps that end above the tolerance.
const UNCONVERGED: f64 = 1e-3;

/// Figures of a seed, or of several.
#[derive(Clone, Copy)]
struct SeedFigures {
    /// Largest depth of a rigid contact [m].
    rigid: Worst,
    /// Largest depth of a contact with a soft object [m].
    soft: Worst,
    /// Largest depth of the foot's sphere below the floor [m].
    foot: Worst,
    /// Largest depth of the object's centre below the floor [m].
    centre: Worst,
    /// Largest rise of work plus stored energy of the contacts above their lowest value so far [J].
    rise: Worst,
    /// Share of the implicit sub-steps that ended above the tolerance.
    unconverged: Worst,
    /// Contacts of leg and object [ticks].
    object_contacts: u64,
    /// Contacts of leg and floor [ticks].
    floor_contacts: u64,
}

impl SeedFigures {
    fn of(seed: u64) -> Self {
        let none = Worst::of(seed);
        Self {
            rigid: none,
            soft: none,
            foot: none,
            centre: none,
            rise: none,
            unconverged: none,
            object_contacts: 0,
            floor_contacts: 0,
        }
    }

    fn or(self, other: Self) -> Self {
        Self {
            rigid: self.rigid.or(other.rigid),
            soft: self.soft.or(other.soft),
            foot: self.foot.or(other.foot),
            centre: self.centre.or(other.centre),
            rise: self.rise.or(other.rise),
            unconverged: self.unconverged.or(other.unconverged),
            object_contacts: self.object_contacts + other.object_contacts,
            floor_contacts: self.floor_contacts + other.floor_contacts,
        }
    }
}

fn run(scenario: &str, seed: u64) -> Result<SeedFigures, SimulationError> {
    let mut settings = script::random(scenario, seed, TICKS);
    let substep = u64::from(settings.plant.contact_substep_us);
    settings.plant.contact_substep_us = env_number("HAPFIC_SUBSTEP_US", substep) as u32;
    let mut simulation = Simulation::new(&settings)?;
    let names = simulation.plant().body_names().to_vec();
    let index_of = |body_name: &str| names.iter().position(|name| name == body_name).unwrap() as u32;
    let first_object = &settings.world.objects[0];
    let (floor, object) = (index_of("floor"), index_of(&first_object.name));
    let is_soft = first_object.surface.stiffness_n_per_m < 1e5;
    let mut figures = SeedFigures::of(seed);
    let (mut lowest, mut unconverged, mut solved) = (f64::INFINITY, 0_u64, 0_u64);
    for _ in 0..TICKS {
        let state = simulation.step()?.state;
        for contact in &state.contacts[..state.contact_count as usize] {
            let pair = [contact.body, contact.against];
            let (has_object, has_floor) = (pair.contains(&object), pair.contains(&floor));
            figures.object_contacts += u64::from(has_object && !has_floor);
            figures.floor_contacts += u64::from(has_floor && !has_object);
            let deepest = if has_object && is_soft { &mut figures.soft } else { &mut figures.rigid };
            deepest.note(contact.depth, state.tick);
        }
        figures.foot.note(FOOT_RADIUS_M - state.foot_position[2], state.tick);
        figures.centre.note(-state.objects[0].position[2], state.tick);
        let balance = state.physics.contact_work_j + state.physics.contact_stored_j;
        lowest = lowest.min(balance);
        figures.rise.note(balance - lowest, state.tick);
        unconverged += u64::from(state.physics.unconverged);
        solved += u64::from(state.physics.contact_substeps);
    }
    figures.unconverged.note(unconverged as f64 / solved.max(1) as f64, TICKS as i64 - 1);
    Ok(figures)
}

/// A number from an environment variable, or its default.
fn env_number(name: &str, default: u64) -> u64 {
    std::env::var(name)
        .map_or(default, |number| number.parse().unwrap_or_else(|_| panic!("{name}: found {number}, expected an integer")))
}

/// Runs all seeds of a scenario, prints the figures, and asserts those that do not depend on the object.
fn run_all(scenario: &str) -> SeedFigures {
    let (first, seeds) = (env_number("HAPFIC_FIRST_SEED", 0), env_number("HAPFIC_SEEDS", SEEDS));
    assert!(seeds > 0, "HAPFIC_SEEDS: found 0, expected a number above zero");
    let results = for_each_seed(seeds, |seed| run(scenario, first + seed).map_err(|error| format!("seed {seed}: {error}")));
    let worst = results.into_iter().map(|result| result.unwrap()).reduce(SeedFigures::or).unwrap();
    println!(
        "{scenario}, {seeds} seeds of {} s: deepest rigid contact {} m, soft {} m; foot below the floor {} m, object's centre {} m; \
         rise of contact energy {} J; unconverged {}; {} contacts of leg and object, {} of leg and floor",
        TICKS / 1000,
        worst.rigid,
        worst.soft,
        worst.foot,
        worst.centre,
        worst.rise,
        worst.unconverged,
        worst.object_contacts,
        worst.floor_contacts
    );
    assert!(worst.rigid.is_below(RIGID_M), "deepest rigid contact: {} m", worst.rigid);
    assert!(worst.foot.is_below(FOOT_BELOW_M), "foot below the floor: {} m", worst.foot);
    assert!(worst.rise.is_below(RISE_J), "rise of contact energy: {} J", worst.rise);
    assert!(worst.unconverged.is_below(UNCONVERGED), "share of sub-steps not converged: {}", worst.unconverged);
    // Without contacts the test proves nothing; fewer seeds than usual are exempt.
    assert!(
        seeds < SEEDS || (worst.object_contacts > 100 && worst.floor_contacts > 100),
        "too few contacts of the leg: {} with the object, {} with the floor",
        worst.object_contacts,
        worst.floor_contacts
    );
    worst
}

#[test]
fn rigid_bodies_random_motion_keeps_depth_and_energy() {
    let worst = run_all("box");
    // In any orientation, the centre is at least half the shortest edge above the floor.
    assert!(worst.centre.is_below(-(0.075 - RIGID_M)), "centre of the box below the floor: {} m", worst.centre);
}

#[test]
fn soft_ball_random_motion_keeps_depth_and_energy() {
    let worst = run_all("ball");
    // F_max can press the ball flat between foot and floor: 100 N give a depth of its radius on either side. At 120 mm,
    // its radius plus the leg's, the leg would pass its centre.
    assert!(worst.soft.is_below(0.115), "largest depth of the ball: {} m", worst.soft);
    assert!(worst.centre.is_below(0.05), "centre of the ball below the floor: {} m", worst.centre);
}
