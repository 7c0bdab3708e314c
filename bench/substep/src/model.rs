//! Description of a scene for another simulator, with figures to check that simulator's model.

use crate::BenchScene;
use crate::plan::{JOINTS, ServoPlan, TICK_S, TICKS};
use crate::run::{SUBSTEP_US, one_friction, set_up};
use anyhow::{Result, anyhow};
use hapfic_config::{Settings, Surface};
use nalgebra::Vector3;
use serde::Serialize;

/// Joint velocities of the check [rad/s]: all joints move.
const CHECK_VELOCITY: [f64; JOINTS] = [0.3, -0.5, 0.7];

/// Model of a scene.
#[derive(Clone, Debug, Serialize)]
pub struct SceneModel {
    scene: BenchScene,
    substep_s: f64,
    tick_s: f64,
    ticks: usize,
    gravity: [f64; 3],
    floor: SurfaceModel,
    objects: Vec<ObjectModel>,
    plan: ServoPlan,
    check: ModelCheck,
}

/// Contact parameters of a surface.
#[derive(Clone, Copy, Debug, Serialize)]
struct SurfaceModel {
    stiffness: f64,
    damping: f64,
    transition_width: f64,
    friction_static: f64,
    friction_dynamic: f64,
    critical_speed: f64,
}

/// A free body.
#[derive(Clone, Debug, Serialize)]
struct ObjectModel {
    name: String,
    mass: f64,
    /// Principal moments of inertia [kg m^2].
    inertia: [f64; 3],
    position: [f64; 3],
    surface: SurfaceModel,
}

/// Figures of the leg's model in the start posture, at [`CHECK_VELOCITY`].
#[derive(Clone, Debug, Serialize)]
struct ModelCheck {
    velocity: [f64; JOINTS],
    /// Position of the foot [m].
    foot: [f64; 3],
    /// M(q).
    mass_matrix: [[f64; JOINTS]; JOINTS],
    /// Gravity, centrifugal and Coriolis torques [N m].
    bias: [f64; JOINTS],
}

fn surface_model(surface: &Surface) -> SurfaceModel {
    SurfaceModel {
        stiffness: surface.stiffness_n_per_m,
        damping: surface.damping_n_s_per_m,
        transition_width: surface.transition_width_m,
        friction_static: surface.friction_static,
        friction_dynamic: surface.friction_dynamic,
        critical_speed: surface.critical_speed_m_per_s,
    }
}

/// Describes a scene.
///
/// # Errors
/// If the scene cannot be set up.
pub fn describe(scene: BenchScene) -> Result<SceneModel> {
    let settings = Settings::load(scene.name(), &one_friction(scene)?)?;
    let floor = settings.world.floor.as_ref().ok_or_else(|| anyhow!("{}: found no floor, expected one", scene.name()))?;
    let (mut plant, plan) = set_up(scene, SUBSTEP_US)?;
    let gravity = Vector3::from(settings.world.gravity_m_per_s2);
    let chain = plant.chain();
    let kin = chain.kinematics(&plan.start);
    let mass = chain.mass_matrix(&kin);
    let bias = chain.bias(&kin, &CHECK_VELOCITY, &gravity);
    let check = ModelCheck {
        velocity: CHECK_VELOCITY,
        foot: kin.tip_position().into(),
        mass_matrix: core::array::from_fn(|i| core::array::from_fn(|j| mass[(i, j)])),
        bias: core::array::from_fn(|i| bias[i]),
    };
    let bodies = settings.world.objects.iter().zip(&plant.world().objects);
    let objects = bodies
        .map(|(object, body)| ObjectModel {
            name: object.name.clone(),
            mass: body.mass,
            inertia: body.inertia.into(),
            position: body.position.into(),
            surface: surface_model(&object.surface),
        })
        .collect();
    Ok(SceneModel {
        scene,
        substep_s: f64::from(SUBSTEP_US) * 1e-6,
        tick_s: TICK_S,
        ticks: TICKS,
        gravity: settings.world.gravity_m_per_s2,
        floor: surface_model(&floor.surface),
        objects,
        plan,
        check,
    })
}
