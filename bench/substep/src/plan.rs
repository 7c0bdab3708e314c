//! Motion of the leg: a joint servo around a path that lands, presses and slides.
//!
//! Torque at tick k, held for the tick: `tau = tau_k + K_p (q_k - q) + K_d (q'_k - q')`. The feed-forward tau_k presses
//! the foot down with the desired force, and compensates the leg's weight.
//!
//! Torque without the servo is not enough. On a floor without friction a constant torque accelerates the foot sideways,
//! and the error would show the speed of that motion instead of the accuracy of the integrator.

use crate::BenchScene;
use anyhow::{Result, bail};
use hapfic_robot::{Chain, JointVector, MAX_JOINTS};
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;

/// Ticks of a run, 1 ms each.
pub const TICKS: usize = 1000;
/// Length of a tick [s].
pub const TICK_S: f64 = 1e-3;
/// Joints of the leg.
pub const JOINTS: usize = 3;
/// K_p of each joint [N m/rad].
const STIFFNESS: f64 = 100.0;
/// K_d of each joint [N m s/rad].
const DAMPING: f64 = 2.0;
/// Gap between the foot and the body below it at the start [m].
const GAP: f64 = 2e-3;

/// Tables of the servo.
#[derive(Clone, Debug, Serialize)]
pub struct ServoPlan {
    /// Joint positions at the start, where the leg is at rest [rad].
    pub start: [f64; JOINTS],
    /// K_p [N m/rad].
    pub stiffness: f64,
    /// K_d [N m s/rad].
    pub damping: f64,
    /// q_k [rad].
    pub position: Vec<[f64; JOINTS]>,
    /// q'_k [rad/s].
    pub velocity: Vec<[f64; JOINTS]>,
    /// tau_k [N m].
    pub torque: Vec<[f64; JOINTS]>,
}

/// Contact of the foot in a scene.
struct PressTarget {
    /// Position of the foot at first contact [m].
    first_contact: Vector3<f64>,
    /// Sliding distance of the foot along x [m].
    slide: f64,
    /// Desired force [N].
    force: f64,
    /// Force along x against the sliding friction [N].
    friction: f64,
    /// Deformation of the body below under the desired force [m].
    deformation: f64,
}

fn press_target(scene: BenchScene) -> PressTarget {
    match scene {
        BenchScene::Floor => PressTarget {
            first_contact: Vector3::new(-0.10, 0.05, 0.02),
            slide: 0.02,
            force: 50.0,
            friction: 0.0,
            deformation: 0.0,
        },
        // Sliding friction under the desired force.
        BenchScene::Box => PressTarget {
            first_contact: Vector3::new(-0.22, -0.07, 0.32),
            slide: -0.04,
            force: 50.0,
            friction: -15.0,
            deformation: 0.0,
        },
        // 30 N on 1e3 N/m, twice: the ball deforms above and below.
        BenchScene::Ball => PressTarget {
            first_contact: Vector3::new(-0.30, 0.05, 0.22),
            slide: -0.01,
            force: 30.0,
            friction: 0.0,
            deformation: 0.06,
        },
    }
}

/// Returns a smooth transition from 0 to 1 between two times [s], and its rate [1/s].
fn blend(t: f64, from: f64, to: f64) -> (f64, f64) {
    let phase = ((t - from) / (to - from)).clamp(0.0, 1.0) * std::f64::consts::PI;
    (0.5 * (1.0 - phase.cos()), 0.5 * phase.sin() * std::f64::consts::PI / (to - from))
}

impl ServoPlan {
    /// Plans a scene: to the pressed position in 0.2 s, hold until 0.5 s, aside until 0.9 s, and hold.
    ///
    /// # Errors
    /// If the foot cannot reach the positions.
    pub fn new(scene: BenchScene, chain: &Chain, near: &[f64], gravity: &Vector3<f64>) -> Result<Self> {
        let target = press_target(scene);
        let above = solve_posture(chain, near, &(target.first_contact + Vector3::z() * GAP))?;
        let pressed = solve_posture(chain, near, &(target.first_contact - Vector3::z() * target.deformation))?;
        let aside = solve_posture(chain, near, &(target.first_contact + Vector3::new(target.slide, 0.0, -target.deformation)))?;
        let torques = [(&pressed, 0.0), (&aside, target.friction)].map(|(q, friction)| {
            let kin = chain.kinematics(q);
            let push = chain.jacobian(&kin).linear_transpose_mul(&Vector3::new(friction, 0.0, -target.force));
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
            let travel = |i: usize| (pressed[i] - above[i], aside[i] - pressed[i]);
            plan.position.push(core::array::from_fn(|i| above[i] + down * travel(i).0 + side * travel(i).1));
            plan.velocity.push(core::array::from_fn(|i| down_rate * travel(i).0 + side_rate * travel(i).1));
            plan.torque.push(core::array::from_fn(|i| torques[0][i] + side * (torques[1][i] - torques[0][i])));
        }
        Ok(plan)
    }

    /// Returns the torque of a tick at joint positions and velocities [N m].
    #[must_use]
    pub fn servo_torque(&self, tick: usize, q: &JointVector, qd: &JointVector) -> JointVector {
        let mut torque = [0.0; MAX_JOINTS];
        for (i, torque) in torque.iter_mut().enumerate().take(JOINTS) {
            *torque = self.torque[tick][i]
                + self.stiffness * (self.position[tick][i] - q[i])
                + self.damping * (self.velocity[tick][i] - qd[i]);
        }
        torque
    }
}

/// Solves for joint positions with the foot at `target`, by Newton's method from `near`.
fn solve_posture(chain: &Chain, near: &[f64], target: &Vector3<f64>) -> Result<[f64; JOINTS]> {
    let mut q: [f64; JOINTS] = match near.try_into() {
        Ok(q) => q,
        Err(_) => bail!("start posture: found {} joints, expected {JOINTS}", near.len()),
    };
    let mut gap = f64::INFINITY;
    for _ in 0..50 {
        let kin = chain.kinematics(&q);
        let offset = target - kin.tip_position();
        gap = offset.norm();
        if gap < 1e-13 {
            return Ok(q);
        }
        let jacobian = chain.jacobian(&kin);
        let columns = Matrix3::from_fn(|i, j| jacobian.linear[j][i]);
        let Some(step) = columns.lu().solve(&offset) else { break };
        for (value, step) in q.iter_mut().zip(step.iter()) {
            // Far from the target a full step may diverge.
            *value += step.clamp(-0.2, 0.2);
        }
    }
    bail!("foot at {target:?}: found an error of {gap:e} m, expected less than 1e-13 m")
}
