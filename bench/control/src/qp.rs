//! The quadratic programme and its solver, built once; each tick overwrites the entries.
//!
//! With n joints the variables are q'' (n), tau (n) and the normal force f:
//!
//! ```text
//! minimise    1/2 q''^T H q'' + g^T q'' + 1/2 w_tau |tau|^2 + 1/2 w_f (f - f_d)^2
//! subject to  M q'' - tau - s J_z^T f = -h          s = 1 in contact, else 0
//!             -tau_max <= tau <= tau_max
//!             0 <= f <= f_max                       a contact cannot pull
//! ```
//!
//! # State between ticks
//! Kept: all memory, the sparsity patterns, the order of elimination, the symbolic factorisation, and the scaling of
//! rows and columns. The solver computes the scaling from the first problem only, so that problem must have a typical
//! posture. Not kept: the last optimum as a start, and with it the set of active limits. An interior-point solver
//! cannot use them: each tick starts from the solver's own initial point, and factorises in each iteration.

use crate::error::QpError;
use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT};
use hapfic_robot::{JointVector, MassMatrix};

/// Tolerance of the solver: absolute and relative gap, and feasibility.
const TOLERANCE: f64 = 1e-6;

/// The entries of one tick's problem.
#[derive(Clone, Debug)]
pub struct QpProblem {
    /// H: the upper triangle of the upper left n x n block is read.
    pub hessian: MassMatrix,
    /// g.
    pub gradient: JointVector,
    /// M.
    pub mass: MassMatrix,
    /// h: Coriolis, centrifugal and gravity terms, and damping [N m].
    pub bias: JointVector,
    /// s J_z^T: joint torques per normal force [N m/N].
    pub normal: JointVector,
    /// f_d [N].
    pub desired_force: f64,
}

/// Limits and weights, the same in each tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QpLimits {
    /// tau_max [N m].
    pub torque: JointVector,
    /// f_max [N].
    pub force: f64,
    /// w_tau [1/(N m)^2]: a larger weight saves torque at the cost of tracking.
    pub torque_weight: f64,
    /// w_f [1/N^2].
    pub force_weight: f64,
}

/// A solver for problems of one shape.
pub struct Qp {
    n: usize,
    force_weight: f64,
    solver: DefaultSolver<f64>,
    hessian: Vec<f64>,
    gradient: Vec<f64>,
    constraints: Vec<f64>,
    bounds: Vec<f64>,
}

impl core::fmt::Debug for Qp {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Qp").field("n", &self.n).finish_non_exhaustive()
    }
}

impl Qp {
    /// Allocates all memory for `n` joints, from a first problem.
    ///
    /// # Errors
    /// [`QpError::Rejected`] if the solver rejects the problem.
    pub fn new(n: usize, limits: &QpLimits, first: &QpProblem) -> Result<Self, QpError> {
        let (variables, rows) = (2 * n + 1, 3 * n + 2);
        let mut hessian = CscMatrix { m: variables, n: variables, colptr: vec![0], rowval: Vec::new(), nzval: Vec::new() };
        for column in 0..variables {
            // Upper triangle, column by column: only joint accelerations are coupled.
            let first_row = if column < n { 0 } else { column };
            hessian.rowval.extend(first_row..=column);
            hessian.colptr.push(hessian.rowval.len());
        }
        hessian.nzval = vec![limits.torque_weight; hessian.rowval.len()];
        if let Some(last) = hessian.nzval.last_mut() {
            *last = limits.force_weight;
        }

        let mut constraints = CscMatrix { m: rows, n: variables, colptr: vec![0], rowval: Vec::new(), nzval: Vec::new() };
        for _ in 0..n {
            constraints.rowval.extend(0..n);
            constraints.nzval.extend(std::iter::repeat_n(0.0, n));
            constraints.colptr.push(constraints.rowval.len());
        }
        for joint in 0..n {
            constraints.rowval.extend([joint, n + joint, 2 * n + joint]);
            constraints.nzval.extend([-1.0, 1.0, -1.0]);
            constraints.colptr.push(constraints.rowval.len());
        }
        constraints.rowval.extend((0..n).chain([3 * n, 3 * n + 1]));
        constraints.nzval.extend(std::iter::repeat_n(0.0, n).chain([-1.0, 1.0]));
        constraints.colptr.push(constraints.rowval.len());

        let mut bounds = vec![0.0; rows];
        for joint in 0..n {
            bounds[n + joint] = limits.torque[joint];
            bounds[2 * n + joint] = limits.torque[joint];
        }
        bounds[3 * n + 1] = limits.force;

        let mut gradient = vec![0.0; variables];
        let force_weight = limits.force_weight;
        write_entries(n, force_weight, first, &mut hessian.nzval, &mut gradient, &mut constraints.nzval, &mut bounds);
        let settings = DefaultSettings {
            verbose: false,
            max_threads: 1,
            tol_gap_abs: TOLERANCE,
            tol_gap_rel: TOLERANCE,
            tol_feas: TOLERANCE,
            // Both would change the shape of the problem, and forbid new entries in place.
            presolve_enable: false,
            input_sparse_dropzeros: false,
            ..DefaultSettings::default()
        };
        let cones = [ZeroConeT(n), NonnegativeConeT(2 * n + 2)];
        let solver = DefaultSolver::new(&hessian, &gradient, &constraints, &bounds, &cones, settings)
            .map_err(|e| QpError::Rejected { cause: e.to_string() })?;
        let (hessian, constraints) = (hessian.nzval, constraints.nzval);
        Ok(Self { n, force_weight, solver, hessian, gradient, constraints, bounds })
    }

    /// Solves the next problem. Returns q'', tau and f in this order.
    ///
    /// # Errors
    /// [`QpError::NotSolved`] if the solver finds no optimum; the message names `tick`.
    pub fn solve(&mut self, problem: &QpProblem, tick: i64) -> Result<&[f64], QpError> {
        let Self { n, force_weight, hessian, gradient, constraints, bounds, solver } = self;
        write_entries(*n, *force_weight, problem, hessian, gradient, constraints, bounds);
        solver.update_data(hessian, gradient, constraints, bounds).map_err(|e| QpError::Rejected { cause: e.to_string() })?;
        solver.solve();
        match solver.solution.status {
            SolverStatus::Solved | SolverStatus::AlmostSolved => Ok(&solver.solution.x),
            status => Err(QpError::NotSolved { tick, status: format!("{status:?}") }),
        }
    }

    /// Returns the iterations of the last solution.
    #[must_use]
    pub fn iterations(&self) -> u32 {
        self.solver.solution.iterations
    }
}

/// Writes the entries of a problem into the sparsity patterns.
fn write_entries(
    n: usize,
    force_weight: f64,
    problem: &QpProblem,
    hessian: &mut [f64],
    gradient: &mut [f64],
    constraints: &mut [f64],
    bounds: &mut [f64],
) {
    let mut entry = 0;
    for column in 0..n {
        for row in 0..=column {
            hessian[entry] = problem.hessian[(row, column)];
            entry += 1;
        }
        for row in 0..n {
            constraints[column * n + row] = problem.mass[(row, column)];
        }
        gradient[column] = problem.gradient[column];
        constraints[n * n + 3 * n + column] = -problem.normal[column];
        bounds[column] = -problem.bias[column];
    }
    gradient[2 * n] = -force_weight * problem.desired_force;
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use hapfic_robot::MAX_JOINTS;

    const LIMITS: QpLimits = QpLimits { torque: [10.0; MAX_JOINTS], force: 100.0, torque_weight: 1e-6, force_weight: 1.0 };

    /// Returns a problem of one joint with inertia 2, lifted by a contact with an arm of 0.5 m.
    fn problem(acceleration: f64, desired_force: f64) -> QpProblem {
        let mut mass = MassMatrix::zeros();
        mass[(0, 0)] = 2.0;
        let mut hessian = MassMatrix::zeros();
        hessian[(0, 0)] = 1.0;
        let (mut gradient, mut bias, mut normal) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        (gradient[0], bias[0], normal[0]) = (-acceleration, 1.0, 0.5);
        QpProblem { hessian, gradient, mass, bias, normal, desired_force }
    }

    #[test]
    fn solve_inactive_limits_reaches_desired_values() {
        let first = problem(3.0, 4.0);
        let mut qp = Qp::new(1, &LIMITS, &first).unwrap();
        let x = qp.solve(&first, 0).unwrap();
        // tau = M q'' + h - J_z f = 6 + 1 - 2.
        assert!((x[0] - 3.0).abs() < 1e-3 && (x[1] - 5.0).abs() < 1e-3 && (x[2] - 4.0).abs() < 1e-3, "{x:?}");
    }

    #[test]
    fn solve_active_limits_hold_and_next_problem_is_independent() {
        let mut qp = Qp::new(1, &LIMITS, &problem(3.0, 4.0)).unwrap();
        let x = qp.solve(&problem(50.0, 0.0), 0).unwrap();
        assert!((x[1] - 10.0).abs() < 1e-3, "{x:?}");
        let x = qp.solve(&problem(0.0, -20.0), 1).unwrap();
        assert!(x[2].abs() < 1e-3 && (x[1] - 1.0).abs() < 1e-3, "{x:?}");
        let x = qp.solve(&problem(3.0, 4.0), 2).unwrap();
        assert!((x[1] - 5.0).abs() < 1e-3, "{x:?}");
        assert!(qp.iterations() > 0);
    }

    #[test]
    fn solve_nan_reports_tick() {
        let mut qp = Qp::new(1, &LIMITS, &problem(3.0, 4.0)).unwrap();
        let error = qp.solve(&problem(f64::NAN, 0.0), 7).unwrap_err().to_string();
        assert!(error.starts_with("tick 7"), "{error}");
    }
}
