//! One implicit step of the velocities under contact: Newton's method in velocity space.
//!
//! The velocities v1 at the end of a sub-step h satisfy
//!
//! ```text
//! (M + h D) v1 = M v0 + h (tau - bias) + h sum_c J_c^T f_c
//! ```
//!
//! The normal force of a contact is taken at the middle of the sub-step (v_m = (v0 + v1) / 2, d_m = d0 - h/2 n.J v_m), which is
//! second order on impacts; friction, whose slope 2 mu_s F_n / v_c is the stiff part, at its end, so that it holds without
//! chatter. The falling branch of mu and the coupling of normal and tangential forces are left out of the matrix (quasi-Newton),
//! which keeps it positive definite.

// Indices read as the algebra does.
#![allow(clippy::needless_range_loop)]

use crate::contact_law::ContactLaw;
use hapfic_ipc::message::{MAX_JOINTS, MAX_OBJECTS};

/// Most velocities a world has.
pub(crate) const MAX_SPEEDS: usize = MAX_JOINTS + 6 * MAX_OBJECTS;
/// Most contact points at a time, joint stops first; with more the sub-step counts as unconverged.
pub(crate) const MAX_POINTS: usize = 32;
/// Most iterations.
const MAX_ITERATIONS: u32 = 25;
/// Residual that counts as solved, N s.
const TOLERANCE: f64 = 1e-10;

/// One row of a contact's Jacobian.
pub(crate) type Row = [f64; MAX_SPEEDS];

/// A contact point, or a joint at its stop (no tangents then).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Point {
    /// Maps velocities to the speed of separation.
    pub(crate) normal: Row,
    /// Maps velocities to the two components of slip.
    pub(crate) tangents: [Row; 2],
    /// Whether friction acts.
    pub(crate) rough: bool,
    /// Depth at the start of the sub-step, m.
    pub(crate) depth: f64,
    /// The law.
    pub(crate) law: ContactLaw,
}

/// Force of a contact point: normal, and the two components of friction, N.
pub(crate) type PointForce = [f64; 3];

/// How a step was solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Solved {
    /// Iterations it took.
    pub(crate) iterations: u32,
    /// Whether the residual ended below the tolerance.
    pub(crate) converged: bool,
}

/// The problem of a sub-step, and the memory to solve it in.
#[derive(Clone, Debug)]
pub(crate) struct Newton {
    /// Velocities that count.
    pub(crate) n: usize,
    /// M + h D, row by row.
    pub(crate) matrix: [Row; MAX_SPEEDS],
    /// M v0 + h (tau - bias).
    pub(crate) impulse: Row,
    /// Velocities at the start.
    pub(crate) v0: Row,
    hessian: [Row; MAX_SPEEDS],
    residual: Row,
    trial: Row,
}

fn dot(a: &Row, b: &Row, n: usize) -> f64 {
    a[..n].iter().zip(&b[..n]).map(|(x, y)| x * y).sum()
}

impl Newton {
    pub(crate) fn new(n: usize) -> Self {
        let zero = [0.0; MAX_SPEEDS];
        Self { n, matrix: [zero; MAX_SPEEDS], impulse: zero, v0: zero, hessian: [zero; MAX_SPEEDS], residual: zero, trial: zero }
    }

    /// Empties matrix, impulse and velocities, for a problem of `n` velocities.
    pub(crate) fn clear(&mut self) {
        for row in &mut self.matrix[..self.n] {
            row[..self.n].fill(0.0);
        }
        self.impulse[..self.n].fill(0.0);
        self.v0[..self.n].fill(0.0);
    }

    /// Velocities at the end of the sub-step, and the force of every point.
    pub(crate) fn solve(&mut self, h: f64, points: &[Point], v: &mut Row, forces: &mut [PointForce]) -> Solved {
        *v = self.v0;
        let mut norm = self.assemble(h, points, v, forces);
        let mut iterations = 0;
        while norm > TOLERANCE && iterations < MAX_ITERATIONS {
            iterations += 1;
            if !factor(&mut self.hessian, self.n) {
                break;
            }
            substitute(&self.hessian, &mut self.residual, self.n);
            let step = self.residual;
            // Where the law bends, a full step may overshoot: halve it until the residual falls, or take the shortest.
            let mut scale = 1.0;
            loop {
                let mut trial = self.trial;
                for i in 0..self.n {
                    trial[i] = v[i] - scale * step[i];
                }
                self.trial = trial;
                let trial_norm = self.assemble(h, points, &trial, forces);
                if trial_norm < norm || scale < 0.1 {
                    norm = trial_norm;
                    *v = trial;
                    break;
                }
                scale *= 0.5;
            }
        }
        Solved { iterations, converged: norm <= TOLERANCE }
    }

    /// Fills forces, residual and matrix at velocities `v`; returns the largest residual, N s.
    fn assemble(&mut self, h: f64, points: &[Point], v: &Row, forces: &mut [PointForce]) -> f64 {
        let n = self.n;
        for i in 0..n {
            self.hessian[i][..n].copy_from_slice(&self.matrix[i][..n]);
            self.residual[i] = dot(&self.matrix[i], v, n) - self.impulse[i];
        }
        for (point, force) in points.iter().zip(forces.iter_mut()) {
            let before = dot(&point.normal, &self.v0, n);
            let middle = 0.5 * (before + dot(&point.normal, v, n));
            let depth = point.depth - 0.5 * h * middle;
            let normal = point.law.normal(depth, -middle);
            *force = [normal.force, 0.0, 0.0];
            if normal.force <= 0.0 {
                continue;
            }
            let slope = 0.5 * (normal.by_rate + 0.5 * h * normal.by_depth).max(0.0);
            self.add(&point.normal, h * normal.force);
            self.add_outer(&point.normal, &point.normal, h * slope);
            if !point.rough {
                continue;
            }
            let slip = [dot(&point.tangents[0], v, n), dot(&point.tangents[1], v, n)];
            let speed = slip[0].hypot(slip[1]);
            let secant = point.law.friction_per_speed(speed) * normal.force;
            for k in 0..2 {
                force[k + 1] = -secant * slip[k];
                self.add(&point.tangents[k], h * force[k + 1]);
            }
            // d(mu v/|v|)/dv = secant (I - t t^T) + mu' t t^T, with mu' not below zero.
            let along = point.law.friction(speed).slope.max(0.0) * normal.force - secant;
            let direction = if speed > 0.0 { [slip[0] / speed, slip[1] / speed] } else { [0.0, 0.0] };
            for a in 0..2 {
                for b in 0..2 {
                    let unit = if a == b { secant } else { 0.0 };
                    let k = unit + along * direction[a] * direction[b];
                    self.add_outer(&point.tangents[a], &point.tangents[b], h * k);
                }
            }
        }
        // Not a number must not pass for solved.
        self.residual[..n].iter().fold(0.0, |worst: f64, r| if r.is_nan() { f64::INFINITY } else { worst.max(r.abs()) })
    }

    /// residual -= impulse along a row.
    fn add(&mut self, row: &Row, impulse: f64) {
        for i in 0..self.n {
            self.residual[i] -= impulse * row[i];
        }
    }

    fn add_outer(&mut self, a: &Row, b: &Row, weight: f64) {
        for i in 0..self.n {
            let scaled = weight * a[i];
            if scaled != 0.0 {
                for j in 0..self.n {
                    self.hessian[i][j] += scaled * b[j];
                }
            }
        }
    }
}

/// Cholesky factor of a symmetric positive definite matrix, in its lower triangle. `false` if it is not.
pub(crate) fn factor(m: &mut [Row; MAX_SPEEDS], n: usize) -> bool {
    for j in 0..n {
        for i in j..n {
            let mut sum = m[i][j];
            for k in 0..j {
                sum -= m[i][k] * m[j][k];
            }
            if i == j {
                if sum <= 0.0 || !sum.is_finite() {
                    return false;
                }
                m[j][j] = sum.sqrt();
            } else {
                m[i][j] = sum / m[j][j];
            }
        }
    }
    true
}

/// Solves with a factor from [`factor`]; `x` holds the right side before and the solution after.
pub(crate) fn substitute(m: &[Row; MAX_SPEEDS], x: &mut Row, n: usize) {
    for i in 0..n {
        let mut sum = x[i];
        for k in 0..i {
            sum -= m[i][k] * x[k];
        }
        x[i] = sum / m[i][i];
    }
    for i in (0..n).rev() {
        let mut sum = x[i];
        for k in i + 1..n {
            sum -= m[k][i] * x[k];
        }
        x[i] = sum / m[i][i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(mass: f64) -> Newton {
        let mut newton = Newton::new(3);
        for i in 0..3 {
            newton.matrix[i][i] = mass;
        }
        newton
    }

    fn unit(i: usize) -> Row {
        let mut row = [0.0; MAX_SPEEDS];
        row[i] = 1.0;
        row
    }

    fn floor_point(depth: f64) -> Point {
        Point {
            normal: unit(2),
            tangents: [unit(0), unit(1)],
            rough: true,
            depth,
            law: ContactLaw {
                stiffness: 1e6,
                damping: 1e4,
                transition_width: 1e-3,
                friction_static: 0.5,
                friction_dynamic: 0.3,
                critical_speed: 1e-3,
            },
        }
    }

    /// A block on the floor under a side force, from rest: where it creeps, the friction carries the load; above mu_s it slides
    /// with the difference to mu_d.
    fn push(mass: f64, share: f64, h: f64, time: f64) -> (f64, u32) {
        let mut newton = block(mass);
        let weight = 9.81 * mass;
        let mut point = floor_point(0.0);
        point.depth = point.law.depth_at(weight);
        let (mut v, mut unconverged) = ([0.0; MAX_SPEEDS], 0);
        let mut forces = [[0.0; 3]];
        for _ in 0..(time / h).round() as usize {
            newton.v0 = v;
            for i in 0..3 {
                newton.impulse[i] = mass * v[i];
            }
            newton.impulse[0] += h * share * weight;
            newton.impulse[2] -= h * weight;
            let solved = newton.solve(h, &[point], &mut v, &mut forces);
            unconverged += u32::from(!solved.converged);
            point.depth -= h * 0.5 * (newton.v0[2] + v[2]);
        }
        (v[0], unconverged)
    }

    #[test]
    fn friction_holds_with_the_creep_of_its_law_at_any_sub_step() {
        // mu(v) = 0.4: r (2 - r) = 0.8.
        let creep = 1e-3 * (1.0 - 0.2_f64.sqrt());
        for h in [1e-5, 2e-5, 2e-4, 1e-3] {
            let (v, unconverged) = push(2.0, 0.4, h, 0.2);
            assert!((v / creep - 1.0).abs() < 1e-3, "{h}: {v} against {creep}");
            assert_eq!(unconverged, 0);
        }
    }

    #[test]
    fn beyond_static_friction_it_slides_against_the_dynamic_one() {
        let (v, _) = push(2.0, 0.7, 2e-5, 0.5);
        let expected = (0.7 - 0.3) * 9.81 * 0.5;
        assert!((v / expected - 1.0).abs() < 0.01, "{v} against {expected}");
    }

    #[test]
    fn without_contact_it_is_the_linear_solution() {
        let mut newton = block(4.0);
        newton.impulse[1] = 8.0;
        let mut v = [0.0; MAX_SPEEDS];
        let solved = newton.solve(1e-3, &[], &mut v, &mut []);
        assert!(solved.converged && solved.iterations == 1);
        assert!((v[1] - 2.0).abs() < 1e-15);
    }
}
