//! Runs of the plant through a scene.

use crate::BenchScene;
use crate::plan::{ServoPlan, TICKS};
use anyhow::{Result, ensure};
use hapfic_config::Settings;
use hapfic_plant::{DriveAction, Plant};
use nalgebra::Vector3;
use serde::Serialize;
use std::time::{Duration, Instant};

/// Compared sub-step [us]: that of the scenarios in contact.
pub const SUBSTEP_US: u32 = 20;
/// Length of a tick [us].
const TICK_US: u32 = 1000;
/// Length of the warm-up run [ticks].
const WARM_UP: usize = 200;

/// Foot position and force after a tick.
#[derive(Clone, Copy, Debug)]
pub struct FootSample {
    /// Position of the foot [m].
    pub foot: Vector3<f64>,
    /// Mean contact force on the foot over the tick [N].
    pub force: Vector3<f64>,
}

/// Result of a run.
#[derive(Clone, Debug)]
pub struct SceneRun {
    /// One sample per tick.
    pub samples: Vec<FootSample>,
    /// Sub-steps that ended above Newton's tolerance.
    pub unconverged: u32,
    /// Largest normal force of any sub-step [N].
    pub peak_n: f64,
    /// Computing time of each tick, without the servo.
    pub durations: Vec<Duration>,
}

/// Returns overrides that set the static friction of every surface to its dynamic one.
///
/// MuJoCo has a single coefficient: with two, the foot would stick in one simulator and slide in the other.
///
/// # Errors
/// If the scenario is invalid.
pub fn one_friction(scene: BenchScene) -> Result<Vec<String>> {
    let world = Settings::load(scene.name(), &[])?.world;
    let floor = world.floor.iter().map(|floor| ("floor".to_owned(), floor.surface.friction_dynamic));
    let objects = world.objects.iter().enumerate();
    let objects = objects.map(|(index, object)| (format!("object.{index}"), object.surface.friction_dynamic));
    Ok(floor.chain(objects).map(|(surface, friction)| format!("world.{surface}.friction_static={friction:?}")).collect())
}

/// Returns the plant of a scene in the plan's start posture, and the plan.
///
/// The sub-step [us] is the same in the air and in contact.
///
/// # Errors
/// If the scenario, its start posture or the plan is invalid.
pub fn set_up(scene: BenchScene, substep_us: u32) -> Result<(Plant, ServoPlan)> {
    let mut overrides = vec![format!("plant.contact_substep_us={substep_us}"), format!("plant.flight_substep_us={substep_us}")];
    overrides.extend(one_friction(scene)?);
    let settings = Settings::load(scene.name(), &overrides)?;
    let mut plant = Plant::new(&settings)?;
    let gravity = Vector3::from(settings.world.gravity_m_per_s2);
    let plan = ServoPlan::new(scene, plant.chain(), &settings.robot.start_position, &gravity)?;
    plant.world().q[..plan.start.len()].copy_from_slice(&plan.start);
    Ok((plant, plan))
}

/// Runs the first ticks of a scene.
///
/// # Errors
/// If the scene cannot be set up, or the state is not finite.
pub fn run(scene: BenchScene, substep_us: u32, ticks: usize) -> Result<SceneRun> {
    let (mut plant, plan) = set_up(scene, substep_us)?;
    let world = plant.world();
    let mut run =
        SceneRun { samples: Vec::with_capacity(ticks), unconverged: 0, peak_n: 0.0, durations: Vec::with_capacity(ticks) };
    for tick in 0..ticks {
        let torque = plan.servo_torque(tick, &world.q, &world.qd);
        let start = Instant::now();
        let tick_result = world.advance(DriveAction::Torque(torque), TICK_US);
        run.durations.push(start.elapsed());
        run.unconverged += tick_result.physics.unconverged;
        run.peak_n = run.peak_n.max(tick_result.peak_normal);
        run.samples.push(FootSample { foot: world.kinematics().tip_position(), force: tick_result.sensed_force });
    }
    ensure!(
        world.is_finite(),
        "{}: found a state that is not finite at sub-steps of {substep_us} us, expected a finite one",
        scene.name()
    );
    Ok(run)
}

/// Cost of a sub-step [ns].
#[derive(Clone, Copy, Debug, Serialize)]
pub struct SubstepCost {
    /// Median over the ticks, insensitive to single interrupted ticks.
    pub median: f64,
    /// Mean over the run, with interruptions.
    pub mean: f64,
}

/// Times one run after a warm-up run.
///
/// # Errors
/// As [`run`].
pub fn time(scene: BenchScene) -> Result<SubstepCost> {
    run(scene, SUBSTEP_US, WARM_UP)?;
    let mut ticks: Vec<f64> = run(scene, SUBSTEP_US, TICKS)?.durations.iter().map(Duration::as_secs_f64).collect();
    let ns = 1e9 / f64::from(TICK_US / SUBSTEP_US);
    Ok(SubstepCost { median: ns * median(&mut ticks), mean: ns * ticks.iter().sum::<f64>() / ticks.len() as f64 })
}

/// Returns the median, and sorts the values.
#[must_use]
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    if values.len() % 2 == 1 { values[middle] } else { 0.5 * (values[middle - 1] + values[middle]) }
}
