//! Implicit step of the velocities under contact: Newton's method in velocity space.
//!
//! The velocities v1 at the end of a sub-step h satisfy
//!
//! ```text
//! (M + h D) v1 = M v0 + h (tau - bias) + h sum_c J_c^T f_c
//! ```
//!
//! The normal force of a contact is that of the midpoint (v_m = (v0 + v1) / 2, d_m = d0 - h/2 n.J v_m): second order on
//! impacts. Friction is that of the end of the sub-step, so that it holds without chatter; its slope 2 mu_s F_n / v_c
//! is the stiff part. The matrix omits the falling branch of mu and the coupling of normal and tangential forces
//! (quasi-Newton), and thus stays positive definite.
//!
//! Within a tick, a sub-step starts from the change of velocity of the one before. It reuses the factored matrix while
//! the residual falls quickly. This warm start changes the number of iterations, not the tolerance.

use crate::point::ConstraintPoint;
use crate::velocities::{MAX_SPEEDS, VelocityVector};
use hapfic_messages::MAX_OBJECTS;
use hapfic_robot::MassMatrix;
use hapfic_robot::cholesky::{factor, substitute};
use nalgebra::{Matrix3, Vector3};

/// Maximum number of iterations.
const MAX_ITERATIONS: u32 = 25;
/// Largest residual of a converged sub-step [N s].
const TOLERANCE: f64 = 1e-10;
/// The same as a force over the sub-step [N]; tighter than [`TOLERANCE`] below 20 us.
const TOLERANCE_FORCE: f64 = 5e-6;
/// Rounding of a residual, per momentum of the sub-step.
const ROUNDING: f64 = 16.0 * f64::EPSILON;
/// Ratio of residuals after and before a step, above which the next step factors a new matrix.
const FACTOR_REUSE_RATIO: f64 = 0.1;

/// Force of a constraint point: normal, and the two components of friction [N].
pub(crate) type ConstraintForce = Vector3<f64>;

/// Outcome of the iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct SolveResult {
    /// Number of iterations.
    pub(crate) iterations: u32,
    /// Whether the last residual is within the tolerance.
    pub(crate) converged: bool,
}

/// Data that a sub-step reuses from the one before.
#[derive(Clone, Debug)]
struct WarmStart {
    /// Number of velocities and length [s] of that sub-step; the rest is invalid for other values.
    size: (usize, f64),
    /// Change of the velocities.
    change: VelocityVector,
    /// Whether the matrix holds a factor.
    factored: bool,
}

/// Equations of a sub-step, and the buffers to solve them. The leg's velocities come first, then six per body.
#[derive(Clone, Debug)]
pub(crate) struct Newton {
    /// Number of the leg's velocities.
    pub(crate) leg: usize,
    /// M + h D of the leg.
    pub(crate) mass: MassMatrix,
    /// Number of bodies.
    pub(crate) count: usize,
    /// Masses [kg] and inertias [kg m^2] of the bodies.
    pub(crate) bodies: [(f64, Matrix3<f64>); MAX_OBJECTS],
    /// M v0 + h (tau - bias).
    pub(crate) impulse: VelocityVector,
    /// Velocities at the start.
    pub(crate) v0: VelocityVector,
    /// Separation speeds of the points at the start [m/s].
    pub(crate) before: Vec<f64>,
    pub(crate) residual: VelocityVector,
    pub(crate) matrix: [VelocityVector; MAX_SPEEDS],
    warm_start: WarmStart,
}

impl Newton {
    /// Creates the equations of a leg with so many speeds, with room for so many points.
    pub(crate) fn new(leg: usize, points: usize) -> Self {
        let zero = [0.0; MAX_SPEEDS];
        Self {
            leg,
            mass: MassMatrix::zeros(),
            count: 0,
            bodies: [(0.0, Matrix3::zeros()); MAX_OBJECTS],
            impulse: zero,
            v0: zero,
            before: vec![0.0; points],
            residual: zero,
            matrix: [zero; MAX_SPEEDS],
            warm_start: WarmStart { size: (0, 0.0), change: zero, factored: false },
        }
    }

    /// Number of velocities.
    pub(crate) fn n(&self) -> usize {
        self.leg + 6 * self.count
    }

    /// Discards the data of the sub-step before: the next sub-step starts cold.
    pub(crate) fn reset_warm_start(&mut self) {
        self.warm_start.size = (0, 0.0);
    }

    /// Solves for the velocities at the end of the sub-step and the force of every point.
    pub(crate) fn solve(
        &mut self,
        h: f64,
        points: &[ConstraintPoint],
        v: &mut VelocityVector,
        forces: &mut [ConstraintForce],
    ) -> SolveResult {
        let n = self.n();
        if self.warm_start.size != (n, h) {
            self.warm_start.size = (n, h);
            self.warm_start.change[..n].fill(0.0);
            self.warm_start.factored = false;
        }
        for (before, point) in self.before.iter_mut().zip(points) {
            *before = point.speeds(&self.v0).x;
        }
        for ((v, before), change) in v.iter_mut().zip(&self.v0).zip(&self.warm_start.change).take(n) {
            *v = before + change;
        }
        // Residuals of large momenta end at their rounding.
        let rounding = self.impulse[..n].iter().fold(0.0, |most: f64, impulse| most.max(impulse.abs())) * ROUNDING;
        let tolerance = TOLERANCE.min(TOLERANCE_FORCE * h).max(rounding);
        let mut norm = self.evaluate(h, points, v, forces);
        let mut iterations = 0;
        // At least one step: accepted residuals would otherwise add up, always with the same sign.
        while (norm > tolerance || iterations == 0) && iterations < MAX_ITERATIONS {
            iterations += 1;
            let kept = self.warm_start.factored;
            if !kept {
                self.assemble(h, points, v);
                if !factor(&mut self.matrix, n) {
                    break;
                }
                self.warm_start.factored = true;
            }
            let mut step = self.residual;
            substitute(&self.matrix, &mut step, n);
            let last = norm;
            // A full step may overshoot where the law bends: halve it until the residual falls, or take the shortest.
            let mut scale = 1.0;
            let mut taken = 0.0;
            loop {
                for i in 0..n {
                    v[i] -= (scale - taken) * step[i];
                }
                norm = self.evaluate(h, points, v, forces);
                if norm < last || norm <= tolerance || scale < 0.1 {
                    break;
                }
                (taken, scale) = (scale, if kept { 0.0 } else { 0.5 * scale });
            }
            // If the residual fell too little, the next step factors a new matrix.
            self.warm_start.factored = norm <= tolerance || norm <= FACTOR_REUSE_RATIO * last;
        }
        if norm > tolerance {
            let (more, last) = self.solve_exactly(h, tolerance, points, v, forces);
            iterations += more;
            norm = last;
            self.warm_start.factored = false;
        }
        for ((change, after), before) in self.warm_start.change.iter_mut().zip(&*v).zip(&self.v0).take(n) {
            *change = after - before;
        }
        SolveResult { iterations, converged: norm <= tolerance }
    }

    /// Fills forces and residual at velocities `v`; returns the largest residual [N s].
    pub(crate) fn evaluate(
        &mut self,
        h: f64,
        points: &[ConstraintPoint],
        v: &VelocityVector,
        forces: &mut [ConstraintForce],
    ) -> f64 {
        let n = self.n();
        let (residual, impulse) = (&mut self.residual, &self.impulse);
        for i in 0..self.leg {
            let momentum: f64 = (0..self.leg).map(|j| self.mass[(i, j)] * v[j]).sum();
            residual[i] = momentum - impulse[i];
        }
        for (index, (mass, inertia)) in self.bodies[..self.count].iter().enumerate() {
            let at = self.leg + 6 * index;
            let momentum = inertia * Vector3::new(v[at + 3], v[at + 4], v[at + 5]);
            for k in 0..3 {
                residual[at + k] = mass * v[at + k] - impulse[at + k];
                residual[at + 3 + k] = momentum[k] - impulse[at + 3 + k];
            }
        }
        for ((point, before), force) in points.iter().zip(&self.before).zip(forces.iter_mut()) {
            *force = point.force(h, *before, &point.speeds(v));
            // Includes NaN.
            if force.x != 0.0 {
                point.apply_jacobian_transpose(&(*force * h), residual);
            }
        }
        // NaN must not count as converged.
        residual[..n].iter().fold(0.0, |worst: f64, r| if r.is_nan() { f64::INFINITY } else { worst.max(r.abs()) })
    }

    /// Fills the lower triangle of the matrix with the masses.
    pub(crate) fn assemble_masses(&mut self) {
        let n = self.n();
        let matrix = &mut self.matrix;
        for (i, row) in matrix[..n].iter_mut().enumerate() {
            row[..=i].fill(0.0);
        }
        for (i, row) in matrix[..self.leg].iter_mut().enumerate() {
            for (j, value) in row[..=i].iter_mut().enumerate() {
                *value = self.mass[(i, j)];
            }
        }
        for (index, (mass, inertia)) in self.bodies[..self.count].iter().enumerate() {
            let at = self.leg + 6 * index;
            for k in 0..3 {
                matrix[at + k][at + k] = *mass;
                for l in 0..=k {
                    matrix[at + 3 + k][at + 3 + l] = inertia[(k, l)];
                }
            }
        }
    }

    /// Fills the lower triangle of the matrix at velocities `v`.
    fn assemble(&mut self, h: f64, points: &[ConstraintPoint], v: &VelocityVector) {
        self.assemble_masses();
        let matrix = &mut self.matrix;
        for (point, before) in points.iter().zip(&self.before) {
            if let Some(slope) = point.slope(h, *before, &point.speeds(v)) {
                point.add_stiffness(&(slope * h), matrix);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact_law::ContactLaw;

    fn block(mass: f64) -> Newton {
        let mut newton = Newton::new(3, 1);
        for i in 0..3 {
            newton.mass[(i, i)] = mass;
        }
        newton
    }

    fn floor_point(depth: f64) -> ConstraintPoint {
        let law = ContactLaw {
            stiffness: 1e6,
            damping: 1e4,
            transition_width: 1e-3,
            friction_static: 0.5,
            friction_dynamic: 0.3,
            critical_speed: 1e-3,
        };
        let mut point = ConstraintPoint::new(depth, law);
        for (index, by) in [Vector3::y(), Vector3::z(), Vector3::x()].into_iter().enumerate() {
            point.add_column(index, by);
        }
        point
    }

    /// Final speed [m/s] and unconverged sub-steps of a block on the floor, pushed from rest with `share` of its
    /// weight.
    fn push(mass: f64, share: f64, h: f64, time: f64) -> (f64, u32) {
        let mut newton = block(mass);
        let weight = 9.81 * mass;
        let mut point = floor_point(0.0);
        point.depth = point.law.depth_at(weight);
        let (mut v, mut unconverged) = ([0.0; MAX_SPEEDS], 0);
        let mut forces = [Vector3::zeros()];
        for _ in 0..(time / h).round() as usize {
            newton.v0 = v;
            for (impulse, v) in newton.impulse.iter_mut().zip(&v).take(3) {
                *impulse = mass * v;
            }
            newton.impulse[0] += h * share * weight;
            newton.impulse[2] -= h * weight;
            let solved = newton.solve(h, std::slice::from_ref(&point), &mut v, &mut forces);
            unconverged += u32::from(!solved.converged);
            point.depth -= h * 0.5 * (newton.v0[2] + v[2]);
        }
        (v[0], unconverged)
    }

    #[test]
    fn newton_friction_any_substep_creeps_by_law() {
        // mu(v) = 0.4: r (2 - r) = 0.8.
        let creep = 1e-3 * (1.0 - 0.2_f64.sqrt());
        for h in [1e-5, 2e-5, 2e-4, 1e-3] {
            let (v, unconverged) = push(2.0, 0.4, h, 0.2);
            assert!((v / creep - 1.0).abs() < 1e-3, "{h}: {v} against {creep}");
            assert_eq!(unconverged, 0);
        }
    }

    #[test]
    fn newton_load_above_static_friction_slides() {
        let (v, _) = push(2.0, 0.7, 2e-5, 0.5);
        let expected = (0.7 - 0.3) * 9.81 * 0.5;
        assert!((v / expected - 1.0).abs() < 0.01, "{v} against {expected}");
    }

    #[test]
    fn newton_without_contact_is_linear() {
        let mut newton = block(4.0);
        newton.impulse[1] = 8.0;
        let mut v = [0.0; MAX_SPEEDS];
        let solved = newton.solve(1e-3, &[], &mut v, &mut []);
        assert!(solved.converged && solved.iterations == 1);
        assert!((v[1] - 2.0).abs() < 1e-15);
    }

    /// Most iterations, unconverged sub-steps and largest residual [N] of a block that hits the floor at these speeds
    /// [m/s].
    fn fall(down: f64, sideways: f64, h: f64) -> (u32, u32, f64) {
        let mass = 2.0;
        let mut newton = block(mass);
        let mut point = floor_point(-2e-4);
        let mut v = [0.0; MAX_SPEEDS];
        (v[0], v[2]) = (sideways, -down);
        let mut forces = [Vector3::zeros()];
        let (mut most, mut unconverged, mut worst) = (0, 0, 0.0_f64);
        for _ in 0..(0.02 / h).round() as usize {
            newton.v0 = v;
            for (impulse, v) in newton.impulse.iter_mut().zip(&v).take(3) {
                *impulse = mass * v;
            }
            newton.impulse[2] -= h * 9.81 * mass;
            let solved = newton.solve(h, std::slice::from_ref(&point), &mut v, &mut forces);
            most = most.max(solved.iterations);
            unconverged += u32::from(!solved.converged);
            let residual = newton.evaluate(h, std::slice::from_ref(&point), &v, &mut forces);
            worst = worst.max(residual / h);
            point.depth -= h * 0.5 * (newton.v0[2] + v[2]);
        }
        (most, unconverged, worst)
    }

    /// Sub-steps [s] up to the plant's default, with speeds down and sideways [m/s].
    fn falls() -> impl Iterator<Item = (f64, f64, f64)> {
        [1e-6, 5e-6, 1e-5, 2e-5].into_iter().flat_map(|h| {
            [0.01, 0.1, 0.5, 2.0, 5.0].into_iter().flat_map(move |down| [0.0, 1e-3, 0.05, 1.0].map(|side| (h, down, side)))
        })
    }

    #[test]
    fn newton_impact_converges_in_bounded_iterations() {
        for (h, down, side) in falls() {
            let (most, unconverged, _) = fall(down, side, h);
            assert!(unconverged == 0 && most <= 20, "{h} s, {down} m/s: {unconverged} unconverged, {most} iterations");
        }
    }

    #[test]
    fn newton_residual_stays_below_its_force_tolerance() {
        for (h, down, side) in falls() {
            let (_, _, residual) = fall(down, side, h);
            assert!(residual <= TOLERANCE_FORCE.max(TOLERANCE / h), "{h} s, {down} m/s: {residual:e} N");
            assert!(h > 1e-5 || residual <= 5.0e-6, "{h} s, {down} m/s: {residual:e} N");
        }
    }

    #[test]
    fn newton_sliding_contact_takes_one_iteration() {
        let (mass, h) = (2.0, 2e-5);
        let weight = 9.81 * mass;
        let (mut newton, mut point) = (block(mass), floor_point(0.0));
        point.depth = point.law.depth_at(weight);
        let (mut v, mut forces, mut iterations) = ([0.0; MAX_SPEEDS], [Vector3::zeros()], 0);
        for step in 0..2000 {
            newton.v0 = v;
            for (impulse, v) in newton.impulse.iter_mut().zip(&v).take(3) {
                *impulse = mass * v;
            }
            newton.impulse[0] += h * 0.7 * weight;
            newton.impulse[2] -= h * weight;
            let solved = newton.solve(h, std::slice::from_ref(&point), &mut v, &mut forces);
            iterations += if step < 1000 { 0 } else { solved.iterations };
            point.depth -= h * 0.5 * (newton.v0[2] + v[2]);
        }
        // Without the warm start it takes six iterations per sub-step.
        assert!(iterations <= 1010, "{iterations} iterations in 1000 sub-steps");
    }
}
