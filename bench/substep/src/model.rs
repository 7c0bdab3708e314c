//! All that another simulator needs to do the same, and what it can check its own model with.

use crate::Scene;
use crate::plan::{JOINTS, Plan, TICK_S, TICKS};
use crate::run::{SUBSTEP_US, one_friction, set_up};
use anyhow::{Result, anyhow};
use hapfic_config::{Settings, Surface};
use nalgebra::Vector3;
use serde::Serialize;

/// Joint velocities at which the models are compared, rad/s: any will do that move every joint.
const MOVING: [f64; JOINTS] = [0.3, -0.5, 0.7];

/// A scene.
#[derive(Clone, Debug, Serialize)]
pub struct Model {
    scene: Scene,
    substep_s: f64,
    tick_s: f64,
    ticks: usize,
    gravity: [f64; 3],
    floor: Feel,
    objects: Vec<Thing>,
    plan: Plan,
    check: Check,
}

/// Contact parameters of a surface.
#[derive(Clone, Copy, Debug, Serialize)]
struct Feel {
    stiffness: f64,
    damping: f64,
    transition_width: f64,
    friction_static: f64,
    friction_dynamic: f64,
    critical_speed: f64,
}

/// A free body.
#[derive(Clone, Debug, Serialize)]
struct Thing {
    name: String,
    mass: f64,
    /// Principal moments, kg m^2.
    inertia: [f64; 3],
    position: [f64; 3],
    feel: Feel,
}

/// What the leg's model says in the plan's start posture, moving.
#[derive(Clone, Debug, Serialize)]
struct Check {
    velocity: [f64; JOINTS],
    /// Foot, m.
    foot: [f64; 3],
    /// M(q).
    mass_matrix: [[f64; JOINTS]; JOINTS],
    /// Gravity, centrifugal and Coriolis torques, N m.
    bias: [f64; JOINTS],
}

fn feel(surface: &Surface) -> Feel {
    Feel {
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
/// If it cannot be set up.
pub fn describe(scene: Scene) -> Result<Model> {
    let settings = Settings::load(scene.name(), &one_friction(scene)?)?;
    let floor = settings.world.floor.as_ref().ok_or_else(|| anyhow!("{}: a floor is expected, there is none", scene.name()))?;
    let (mut plant, plan) = set_up(scene, SUBSTEP_US)?;
    let gravity = Vector3::from(settings.world.gravity_m_per_s2);
    let chain = plant.chain();
    let kin = chain.kinematics(&plan.start);
    let mass = chain.mass_matrix(&kin);
    let bias = chain.bias(&kin, &MOVING, &gravity);
    let check = Check {
        velocity: MOVING,
        foot: kin.tip_position().into(),
        mass_matrix: core::array::from_fn(|i| core::array::from_fn(|j| mass[(i, j)])),
        bias: core::array::from_fn(|i| bias[i]),
    };
    let bodies = settings.world.objects.iter().zip(&plant.world().objects);
    let objects = bodies
        .map(|(object, body)| Thing {
            name: object.name.clone(),
            mass: body.mass,
            inertia: body.inertia.into(),
            position: body.position.into(),
            feel: feel(&object.surface),
        })
        .collect();
    Ok(Model {
        scene,
        substep_s: f64::from(SUBSTEP_US) * 1e-6,
        tick_s: TICK_S,
        ticks: TICKS,
        gravity: settings.world.gravity_m_per_s2,
        floor: feel(&floor.surface),
        objects,
        plan,
        check,
    })
}
