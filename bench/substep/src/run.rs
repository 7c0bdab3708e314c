//! Runs of the plant through a scene.

use crate::Scene;
use crate::plan::{Plan, TICKS};
use anyhow::{Result, ensure};
use hapfic_config::Settings;
use hapfic_plant::{Action, Plant};
use nalgebra::Vector3;
use serde::Serialize;
use std::time::{Duration, Instant};

/// Sub-step that is compared, us: the scenarios' in contact.
pub const SUBSTEP_US: u32 = 20;
/// Microseconds of a tick.
const TICK_US: u32 = 1000;
/// Ticks before time is taken.
const WARM_UP: usize = 200;

/// What is known after a tick.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Foot, m.
    pub foot: Vector3<f64>,
    /// Mean contact force on the foot over the tick, N.
    pub force: Vector3<f64>,
}

/// What a run came to.
#[derive(Clone, Debug)]
pub struct Run {
    /// One a tick.
    pub samples: Vec<Sample>,
    /// Sub-steps that ended above Newton's tolerance.
    pub unconverged: u32,
    /// Largest normal force of any sub-step, N.
    pub peak_n: f64,
    /// Time each tick took, without the servo.
    pub took: Vec<Duration>,
}

/// Overrides that make the static friction of every surface its dynamic one: MuJoCo has a single coefficient, and with two the foot
/// would stick here and slide there.
///
/// # Errors
/// If the scenario is invalid.
pub fn one_friction(scene: Scene) -> Result<Vec<String>> {
    let world = Settings::load(scene.name(), &[])?.world;
    let floor = world.floor.iter().map(|floor| ("floor".to_owned(), floor.surface.friction_dynamic));
    let objects = world.objects.iter().enumerate();
    let objects = objects.map(|(index, object)| (format!("object.{index}"), object.surface.friction_dynamic));
    Ok(floor.chain(objects).map(|(place, friction)| format!("world.{place}.friction_static={friction:?}")).collect())
}

/// The plant of a scene with one sub-step in the air and in contact, us, and its plan; the leg is where the plan starts.
///
/// # Errors
/// If the scenario, its start or the plan is invalid.
pub fn set_up(scene: Scene, substep_us: u32) -> Result<(Plant, Plan)> {
    let mut overrides = vec![format!("plant.contact_substep_us={substep_us}"), format!("plant.flight_substep_us={substep_us}")];
    overrides.extend(one_friction(scene)?);
    let settings = Settings::load(scene.name(), &overrides)?;
    let mut plant = Plant::new(&settings)?;
    let gravity = Vector3::from(settings.world.gravity_m_per_s2);
    let plan = Plan::new(scene, plant.chain(), &settings.robot.start_position, &gravity)?;
    plant.world().q[..plan.start.len()].copy_from_slice(&plan.start);
    Ok((plant, plan))
}

/// Runs the first ticks of a scene.
///
/// # Errors
/// If it cannot be set up, or the state left the finite numbers.
pub fn run(scene: Scene, substep_us: u32, ticks: usize) -> Result<Run> {
    let (mut plant, plan) = set_up(scene, substep_us)?;
    let world = plant.world();
    let mut run = Run { samples: Vec::with_capacity(ticks), unconverged: 0, peak_n: 0.0, took: Vec::with_capacity(ticks) };
    for tick in 0..ticks {
        let torque = plan.drive(tick, &world.q, &world.qd);
        let start = Instant::now();
        let advance = world.advance(Action::Torque(torque), TICK_US);
        run.took.push(start.elapsed());
        run.unconverged += advance.physics.unconverged;
        run.peak_n = run.peak_n.max(advance.peak_normal);
        run.samples.push(Sample { foot: world.kinematics().tip_position(), force: advance.sensed_force });
    }
    ensure!(world.is_finite(), "{}: the simulation left the finite numbers at sub-steps of {substep_us} us", scene.name());
    Ok(run)
}

/// What a sub-step costs, ns.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Cost {
    /// In the median over the ticks, which one that the machine interrupted does not move.
    pub median: f64,
    /// In the mean over the run, interruptions included.
    pub mean: f64,
}

/// Times one run, after a short one that is not counted.
///
/// # Errors
/// As [`run`].
pub fn time(scene: Scene) -> Result<Cost> {
    run(scene, SUBSTEP_US, WARM_UP)?;
    let mut ticks: Vec<f64> = run(scene, SUBSTEP_US, TICKS)?.took.iter().map(Duration::as_secs_f64).collect();
    let ns = 1e9 / f64::from(TICK_US / SUBSTEP_US);
    Ok(Cost { median: ns * median(&mut ticks), mean: ns * ticks.iter().sum::<f64>() / ticks.len() as f64 })
}

/// The median; sorts.
#[must_use]
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    if values.len() % 2 == 1 { values[middle] } else { 0.5 * (values[middle - 1] + values[middle]) }
}
