//! Operational-space control: foot accelerations that follow a reference, and a normal force in contact.

use crate::acceleration::tip_bias_acceleration;
use crate::error::QpError;
use crate::qp::{Qp, QpLimits, QpProblem};
use hapfic_messages::{Parameters, State};
use hapfic_robot::{Chain, JointVector, MAX_JOINTS, MassMatrix};
use nalgebra::Vector3;

/// Normal force above which the foot is in contact [N].
const TOUCH_N: f64 = 1.0;
/// Weight of the joint accelerations beside those of the foot [m^2]: keeps the problem strictly convex at a straight
/// knee.
const POSTURE_WEIGHT: f64 = 1e-4;

/// Feedback gains of the foot's acceleration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// Acceleration per position error [1/s^2].
    pub position: f64,
    /// Acceleration per velocity error [1/s].
    pub velocity: f64,
}

impl Default for Gains {
    /// Critically damped gains at 50 rad/s: the bandwidth that a dead time of one tick allows without further
    /// compensation.
    fn default() -> Self {
        Self { position: 2500.0, velocity: 100.0 }
    }
}

/// Desired motion and force of the foot, world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Task<'a> {
    /// x_d [m].
    pub position: [f64; 3],
    /// x_d' [m/s].
    pub velocity: [f64; 3],
    /// x_d'' [m/s^2].
    pub acceleration: [f64; 3],
    /// Parameters of the operator: F_d, or without F_d, K0 and F_max, by which a reference inside the floor presses.
    pub parameters: &'a Parameters,
}

/// Optimum of a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QpSolution {
    /// tau [N m].
    pub torque: JointVector,
    /// q'' [rad/s^2].
    pub acceleration: JointVector,
    /// f [N].
    pub normal_force: f64,
}

/// The QP controller, for level floors.
#[derive(Debug)]
pub struct OperationalSpace {
    chain: Chain,
    gravity: Vector3<f64>,
    gains: Gains,
    qp: Qp,
}

impl OperationalSpace {
    /// Creates the controller of a robot under gravity [m/s^2], and allocates all memory.
    ///
    /// `typical` and `task` are a typical state and task: the solver scales its problems by them.
    ///
    /// # Errors
    /// [`QpError`] if state and robot do not match, or the solver rejects the problem.
    pub fn new(chain: Chain, gravity: [f64; 3], gains: Gains, typical: &State, task: &Task<'_>) -> Result<Self, QpError> {
        let mut torque = [0.0; MAX_JOINTS];
        for (limit, joint) in torque.iter_mut().zip(chain.joints()) {
            *limit = joint.effort;
        }
        let limits = QpLimits { torque, force: task.parameters.max_force[2], torque_weight: 1e-6, force_weight: 1.0 };
        let gravity = gravity.into();
        let first = problem(&chain, &gravity, &gains, typical, task)?;
        let qp = Qp::new(chain.dof(), &limits, &first)?;
        Ok(Self { chain, gravity, gains, qp })
    }

    /// Computes one control tick.
    ///
    /// # Errors
    /// [`QpError`] if the state belongs to another robot, or the problem has no solution.
    pub fn step(&mut self, state: &State, task: &Task<'_>) -> Result<QpSolution, QpError> {
        let problem = self.problem(state, task)?;
        let n = self.chain.dof();
        let x = self.qp.solve(&problem, state.tick)?;
        let mut solution = QpSolution { torque: [0.0; MAX_JOINTS], acceleration: [0.0; MAX_JOINTS], normal_force: x[2 * n] };
        solution.acceleration[..n].copy_from_slice(&x[..n]);
        solution.torque[..n].copy_from_slice(&x[n..2 * n]);
        Ok(solution)
    }

    /// Builds the problem of a tick: the whole tick without the solver.
    ///
    /// # Errors
    /// [`QpError::Joints`] if the state belongs to another robot.
    pub fn problem(&self, state: &State, task: &Task<'_>) -> Result<QpProblem, QpError> {
        problem(&self.chain, &self.gravity, &self.gains, state, task)
    }

    /// Returns the iterations of the solver in the last tick.
    #[must_use]
    pub fn iterations(&self) -> u32 {
        self.qp.iterations()
    }
}

fn problem(chain: &Chain, gravity: &Vector3<f64>, gains: &Gains, state: &State, task: &Task<'_>) -> Result<QpProblem, QpError> {
    let n = chain.dof();
    if state.joints as usize != n {
        return Err(QpError::Joints { found: state.joints, expected: n });
    }
    let qd = &state.joint_velocity[..n];
    let kin = chain.kinematics(&state.joint_position[..n]);
    let jacobian = chain.jacobian(&kin);
    let velocity = jacobian.linear_mul(qd);
    let position_error = Vector3::from(task.position) - kin.tip_position();
    let velocity_error = Vector3::from(task.velocity) - velocity;
    let mut desired = Vector3::from(task.acceleration) + position_error * gains.position + velocity_error * gains.velocity;

    let touching = state.foot_force[2] > TOUCH_N;
    let mut desired_force = 0.0;
    if touching {
        let p = task.parameters;
        // Without F_d the depth of the reference below the foot sets the force.
        let force = if p.desired_force[2] > 0.0 { p.desired_force[2] } else { -p.stiffness[2] * position_error.z };
        desired_force = force.clamp(0.0, p.max_force[2]);
        desired.z = -gains.velocity * velocity.z;
    }

    // |J q'' + J' q' - desired|^2, and |q''|^2 with a small weight.
    let remaining = desired - tip_bias_acceleration(chain, &kin, qd);
    let mut problem = QpProblem {
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
        problem.gradient[column] = -jacobian.linear[column].dot(&remaining);
        problem.bias[column] += chain.joints()[column].damping * rate;
        if touching {
            problem.normal[column] = jacobian.linear[column].z;
        }
    }
    Ok(problem)
}
