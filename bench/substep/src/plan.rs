//! What the leg is told to do: a joint servo around a path that lands, presses and slides.
//!
//! Torque at tick k, held for the tick: `tau = tau_k + K_p (q_k - q) + K_d (q'_k - q')`. The feed-forward tau_k presses the foot down
//! with the desired force and carries the leg's weight. Torque alone, without the servo, would not do: a foot pressed on a floor
//! without friction by a constant torque runs away, and what a run then shows is how fast, not how well it was integrated.

use crate::Scene;
use anyhow::{Result, bail};
use hapfic_robot::{Chain, JointVector, MAX_JOINTS};
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;

/// Ticks of a run, 1 ms each.
pub const TICKS: usize = 1000;
/// Length of a tick, s.
pub const TICK_S: f64 = 1e-3;
/// Joints of the leg.
pub const JOINTS: usize = 3;
/// K_p of each joint, N m/rad.
const STIFFNESS: f64 = 100.0;
/// K_d of each joint, N m s/rad.
const DAMPING: f64 = 2.0;
/// Gap between the foot and what is below it at the start, m.
const GAP: f64 = 2e-3;

/// The servo's tables.
#[derive(Clone, Debug, Serialize)]
pub struct Plan {
    /// Joint positions at the start, rad; the leg is at rest.
    pub start: [f64; JOINTS],
    /// K_p, N m/rad.
    pub stiffness: f64,
    /// K_d, N m s/rad.
    pub damping: f64,
    /// q_k, rad.
    pub position: Vec<[f64; JOINTS]>,
    /// q'_k, rad/s.
    pub velocity: Vec<[f64; JOINTS]>,
    /// tau_k, N m.
    pub torque: Vec<[f64; JOINTS]>,
}

/// Where a scene is pressed.
struct Place {
    /// Foot at touch, m.
    touch: Vector3<f64>,
    /// How far the foot slides along x, m.
    slide: f64,
    /// Desired force, N.
    force: f64,
    /// Push along x against the friction of sliding, N.
    drag: f64,
    /// How far what is below gives under that force, m.
    give: f64,
}

fn place(scene: Scene) -> Place {
    match scene {
        Scene::Floor => Place { touch: Vector3::new(-0.10, 0.05, 0.02), slide: 0.02, force: 50.0, drag: 0.0, give: 0.0 },
        // The friction of the desired force.
        Scene::Box => Place { touch: Vector3::new(-0.22, -0.07, 0.32), slide: -0.04, force: 50.0, drag: -15.0, give: 0.0 },
        // 30 N on 1e3 N/m, twice: the ball gives above and below.
        Scene::Ball => Place { touch: Vector3::new(-0.30, 0.05, 0.22), slide: -0.01, force: 30.0, drag: 0.0, give: 0.06 },
    }
}

/// From 0 to 1 between two times, s, level at both ends, and its rate, 1/s.
fn blend(t: f64, from: f64, to: f64) -> (f64, f64) {
    let phase = ((t - from) / (to - from)).clamp(0.0, 1.0) * std::f64::consts::PI;
    (0.5 * (1.0 - phase.cos()), 0.5 * phase.sin() * std::f64::consts::PI / (to - from))
}

impl Plan {
    /// The plan of a scene: to the pressed position in 0.2 s, held until 0.5 s, aside until 0.9 s, and held.
    ///
    /// # Errors
    /// If the foot cannot get there.
    pub fn new(scene: Scene, chain: &Chain, near: &[f64], gravity: &Vector3<f64>) -> Result<Self> {
        let place = place(scene);
        let above = reach(chain, near, &(place.touch + Vector3::z() * GAP))?;
        let pressed = reach(chain, near, &(place.touch - Vector3::z() * place.give))?;
        let aside = reach(chain, near, &(place.touch + Vector3::new(place.slide, 0.0, -place.give)))?;
        let torques = [(&pressed, 0.0), (&aside, place.drag)].map(|(q, drag)| {
            let kin = chain.kinematics(q);
            let push = chain.jacobian(&kin).linear_transpose_mul(&Vector3::new(drag, 0.0, -place.force));
            let weight = chain.gravity_torque(&kin, gravity);
            core::array::from_fn::<f64, JOINTS, _>(|i| push[i] + weight[i])
        });
        let mut plan = Self {
            start: above,
            stiffness: STIFFNESS,
            damping: DAMPING,
            position: Vec::with_capacity(TICKS),
            velocity: Vec::with_capacity(TICKS),
            torque: Vec::with_capacity(TICKS),
        };
        for tick in 0..TICKS {
            let t = tick as f64 * TICK_S;
            let ((down, down_rate), (side, side_rate)) = (blend(t, 0.0, 0.2), blend(t, 0.5, 0.9));
            let way = |i: usize| (pressed[i] - above[i], aside[i] - pressed[i]);
            plan.position.push(core::array::from_fn(|i| above[i] + down * way(i).0 + side * way(i).1));
            plan.velocity.push(core::array::from_fn(|i| down_rate * way(i).0 + side_rate * way(i).1));
            plan.torque.push(core::array::from_fn(|i| torques[0][i] + side * (torques[1][i] - torques[0][i])));
        }
        Ok(plan)
    }

    /// Torque of a tick at joint positions and velocities, N m.
    #[must_use]
    pub fn drive(&self, tick: usize, q: &JointVector, qd: &JointVector) -> JointVector {
        let mut torque = [0.0; MAX_JOINTS];
        for (i, torque) in torque.iter_mut().enumerate().take(JOINTS) {
            *torque = self.torque[tick][i]
                + self.stiffness * (self.position[tick][i] - q[i])
                + self.damping * (self.velocity[tick][i] - qd[i]);
        }
        torque
    }
}

/// Joint positions near others that bring the foot to a place, by Newton's method.
fn reach(chain: &Chain, near: &[f64], target: &Vector3<f64>) -> Result<[f64; JOINTS]> {
    let mut q: [f64; JOINTS] = match near.try_into() {
        Ok(q) => q,
        Err(_) => bail!("the start posture has {} joints, the leg of this comparison has {JOINTS}", near.len()),
    };
    let mut gap = f64::INFINITY;
    for _ in 0..50 {
        let kin = chain.kinematics(&q);
        let missing = target - kin.tip_position();
        gap = missing.norm();
        if gap < 1e-13 {
            return Ok(q);
        }
        let jacobian = chain.jacobian(&kin);
        let columns = Matrix3::from_fn(|i, j| jacobian.linear[j][i]);
        let Some(step) = columns.lu().solve(&missing) else { break };
        for (value, step) in q.iter_mut().zip(step.iter()) {
            // Far from the place the whole step may lead astray.
            *value += step.clamp(-0.2, 0.2);
        }
    }
    bail!("the foot does not get to {target:?}: {gap:e} m are missing, less than 1e-13 m expected")
}
