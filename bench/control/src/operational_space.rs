//! Operational-space control: accelerations of the foot that follow a reference, and a force where it touches.

use crate::acceleration::tip_bias_acceleration;
use crate::error::QpError;
use crate::qp::{Limits, Problem, Qp};
use hapfic_messages::{Parameters, State};
use hapfic_robot::{Chain, JointVector, MAX_JOINTS, MassMatrix};
use nalgebra::Vector3;

/// Normal force from which on the foot counts as touching, N.
const TOUCH_N: f64 = 1.0;
/// Weight of the joints' accelerations beside the foot's, m^2: keeps the problem strictly convex at a straight knee.
const POSTURE_WEIGHT: f64 = 1e-4;

/// How hard it follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// Acceleration per position error, 1/s^2.
    pub position: f64,
    /// Acceleration per velocity error, 1/s.
    pub velocity: f64,
}

impl Default for Gains {
    /// Critically damped at 50 rad/s: as fast as the dead time of one tick lets it be without effort.
    fn default() -> Self {
        Self { position: 2500.0, velocity: 100.0 }
    }
}

/// What the foot should do, world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Task<'a> {
    /// x_d, m.
    pub position: [f64; 3],
    /// x_d', m/s.
    pub velocity: [f64; 3],
    /// x_d'', m/s^2.
    pub acceleration: [f64; 3],
    /// The operator's parameters: F_d, or where there is no wish, K0 and F_max, by which a reference inside the floor presses.
    pub parameters: &'a Parameters,
}

/// What it came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// tau, N m.
    pub torque: JointVector,
    /// q'', rad/s^2.
    pub acceleration: JointVector,
    /// f, N.
    pub normal_force: f64,
}

/// The controller; floors are level.
#[derive(Debug)]
pub struct OperationalSpace {
    chain: Chain,
    gravity: Vector3<f64>,
    gains: Gains,
    qp: Qp,
}

impl OperationalSpace {
    /// For a robot under gravity, m/s^2, with all memory it will need. `usual` and `task` are a state and a task of the usual kind:
    /// the solver scales its problems by them.
    ///
    /// # Errors
    /// [`QpError`] if state and robot do not fit together or the solver refuses the problem.
    pub fn new(chain: Chain, gravity: [f64; 3], gains: Gains, usual: &State, task: &Task<'_>) -> Result<Self, QpError> {
        let mut torque = [0.0; MAX_JOINTS];
        for (limit, joint) in torque.iter_mut().zip(chain.joints()) {
            *limit = joint.effort;
        }
        let limits = Limits { torque, force: task.parameters.max_force[2], torque_weight: 1e-6, force_weight: 1.0 };
        let gravity = gravity.into();
        let first = problem(&chain, &gravity, &gains, usual, task)?;
        let qp = Qp::new(chain.dof(), &limits, &first)?;
        Ok(Self { chain, gravity, gains, qp })
    }

    /// One control tick.
    ///
    /// # Errors
    /// [`QpError`] if the state is another robot's, or the problem has no solution.
    pub fn step(&mut self, state: &State, task: &Task<'_>) -> Result<Solution, QpError> {
        let problem = self.problem(state, task)?;
        let n = self.chain.dof();
        let x = self.qp.solve(&problem, state.tick)?;
        let mut solution = Solution { torque: [0.0; MAX_JOINTS], acceleration: [0.0; MAX_JOINTS], normal_force: x[2 * n] };
        solution.acceleration[..n].copy_from_slice(&x[..n]);
        solution.torque[..n].copy_from_slice(&x[n..2 * n]);
        Ok(solution)
    }

    /// The problem of a tick: all of the tick but the solver.
    ///
    /// # Errors
    /// [`QpError::Joints`] if the state is another robot's.
    pub fn problem(&self, state: &State, task: &Task<'_>) -> Result<Problem, QpError> {
        problem(&self.chain, &self.gravity, &self.gains, state, task)
    }

    /// Iterations of the solver in the last tick.
    #[must_use]
    pub fn iterations(&self) -> u32 {
        self.qp.iterations()
    }
}

fn problem(chain: &Chain, gravity: &Vector3<f64>, gains: &Gains, state: &State, task: &Task<'_>) -> Result<Problem, QpError> {
    let n = chain.dof();
    if state.joints as usize != n {
        return Err(QpError::Joints { found: state.joints, expected: n });
    }
    let qd = &state.joint_velocity[..n];
    let kin = chain.kinematics(&state.joint_position[..n]);
    let jacobian = chain.jacobian(&kin);
    let velocity = jacobian.linear_mul(qd);
    let off = Vector3::from(task.position) - kin.tip_position();
    let off_rate = Vector3::from(task.velocity) - velocity;
    let mut desired = Vector3::from(task.acceleration) + off * gains.position + off_rate * gains.velocity;

    let touching = state.foot_force[2] > TOUCH_N;
    let mut desired_force = 0.0;
    if touching {
        let p = task.parameters;
        // As deep as the reference lies below the foot, so hard it presses.
        let pressed = if p.desired_force[2] > 0.0 { p.desired_force[2] } else { -p.stiffness[2] * off.z };
        desired_force = pressed.clamp(0.0, p.max_force[2]);
        desired.z = -gains.velocity * velocity.z;
    }

    // |J q'' + J' q' - desired|^2, and a little of |q''|^2.
    let missing = desired - tip_bias_acceleration(chain, &kin, qd);
    let mut problem = Problem {
        hessian: MassMatrix::zeros(),
        gradient: [0.0; MAX_JOINTS],
        mass: chain.mass_matrix(&kin),
        bias: chain.bias(&kin, qd, gravity),
        normal: [0.0; MAX_JOINTS],
        desired_force,
    };
    for (column, rate) in qd.iter().enumerate() {
        for row in 0..=column {
            problem.hessian[(row, column)] = jacobian.linear[row].dot(&jacobian.linear[column]);
        }
        problem.hessian[(column, column)] += POSTURE_WEIGHT;
        problem.gradient[column] = -jacobian.linear[column].dot(&missing);
        problem.bias[column] += chain.joints()[column].damping * rate;
        if touching {
            problem.normal[column] = jacobian.linear[column].z;
        }
    }
    Ok(problem)
}
