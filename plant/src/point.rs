//! A contact point: which speeds it depends on, its force, and how that force changes with the speeds.

use crate::contact_law::ContactLaw;
use crate::velocities::{MAX_SPEEDS, VelocityVector};
use arrayvec::ArrayVec;
use hapfic_messages::MAX_JOINTS;
use nalgebra::{Matrix3, Vector3};

/// Most speeds a point depends on: those of two bodies, of which the leg is one at most.
const MAX_COLUMNS: usize = if MAX_JOINTS > 6 { MAX_JOINTS + 6 } else { 12 };

/// What one speed adds to the speeds at a point.
#[derive(Clone, Copy, Debug)]
struct Column {
    /// Which speed.
    index: usize,
    /// Separation, and the two components of slip, per speed.
    by: Vector3<f64>,
}

/// A contact point, or a joint at its stop (no slip then).
///
/// Speeds and forces at it have three components: along the normal (separation), and the two across it (slip, friction).
#[derive(Clone, Debug)]
pub(crate) struct Point {
    /// Columns of its Jacobian that are not zero, in the order of the speeds.
    columns: ArrayVec<Column, MAX_COLUMNS>,
    /// Whether friction acts.
    rough: bool,
    /// Depth at the start of the sub-step, m.
    pub(crate) depth: f64,
    /// The law.
    pub(crate) law: ContactLaw,
}

impl Point {
    /// A point that does not depend on any speed yet.
    pub(crate) fn new(depth: f64, law: ContactLaw) -> Self {
        Self { columns: ArrayVec::new(), rough: law.friction_static > 0.0, depth, law }
    }

    /// Says what the speed `index` adds; speeds come in their order.
    pub(crate) fn depends_on(&mut self, index: usize, by: Vector3<f64>) {
        debug_assert!(index < MAX_SPEEDS && self.columns.last().is_none_or(|last| last.index < index));
        self.columns.push(Column { index, by });
    }

    /// Speeds at the point.
    #[inline]
    pub(crate) fn speeds(&self, v: &VelocityVector) -> Vector3<f64> {
        self.columns.iter().fold(Vector3::zeros(), |sum, column| sum + column.by * v[column.index])
    }

    /// `residual -= J^T impulse`.
    #[inline]
    pub(crate) fn apply_jacobian_transpose(&self, impulse: &Vector3<f64>, residual: &mut VelocityVector) {
        for column in &self.columns {
            residual[column.index] -= column.by.dot(impulse);
        }
    }

    /// `matrix += J^T K J`, in the lower triangle; K is symmetric.
    pub(crate) fn add_stiffness(&self, k: &Matrix3<f64>, matrix: &mut [VelocityVector; MAX_SPEEDS]) {
        for (place, column) in self.columns.iter().enumerate() {
            let force = k * column.by;
            let row = &mut matrix[column.index];
            for other in &self.columns[..=place] {
                row[other.index] += force.dot(&other.by);
            }
        }
    }

    /// Depth and separation speed at the middle of a sub-step `h`, s, from the separation speeds at its ends.
    #[inline]
    fn middle(&self, h: f64, before: f64, after: f64) -> (f64, f64) {
        let speed = 0.5 * (before + after);
        (self.depth - 0.5 * h * speed, speed)
    }

    /// Force at the speeds `after` a sub-step of `h`, s, that began with the separation speed `before`.
    #[inline]
    pub(crate) fn force(&self, h: f64, before: f64, after: &Vector3<f64>) -> Vector3<f64> {
        let (depth, speed) = self.middle(h, before, after.x);
        let normal = self.law.normal(depth, -speed).force;
        if normal <= 0.0 {
            return Vector3::zeros();
        }
        if !self.rough {
            return Vector3::new(normal, 0.0, 0.0);
        }
        let slip = (after.y * after.y + after.z * after.z).sqrt();
        let secant = self.law.friction_per_speed(slip) * normal;
        Vector3::new(normal, -secant * after.y, -secant * after.z)
    }

    /// How much less force there is per speed after the sub-step, N s/m; none where there is no force.
    ///
    /// Without the falling branch of mu and without what the normal force does to friction, so that it is symmetric and positive
    /// semidefinite.
    pub(crate) fn slope(&self, h: f64, before: f64, after: &Vector3<f64>) -> Option<Matrix3<f64>> {
        let (depth, speed) = self.middle(h, before, after.x);
        let normal = self.law.normal(depth, -speed);
        if normal.force <= 0.0 {
            return None;
        }
        let mut slope = Matrix3::zeros();
        slope.m11 = 0.5 * (normal.by_rate + 0.5 * h * normal.by_depth).max(0.0);
        if self.rough {
            let slip = (after.y * after.y + after.z * after.z).sqrt();
            let secant = self.law.friction_per_speed(slip) * normal.force;
            // d(mu v/|v|)/dv = secant (I - t t^T) + mu' t t^T, with mu' not below zero.
            let along = self.law.friction(slip).slope.max(0.0) * normal.force - secant;
            let (y, z) = if slip > 0.0 { (after.y / slip, after.z / slip) } else { (0.0, 0.0) };
            slope.m22 = secant + along * y * y;
            slope.m33 = secant + along * z * z;
            slope.m23 = along * y * z;
            slope.m32 = slope.m23;
        }
        Some(slope)
    }
}
