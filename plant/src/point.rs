//! Constraint point: its Jacobian, its force, and the derivative of the force.

use crate::contact_law::ContactLaw;
use crate::velocities::{MAX_SPEEDS, VelocityVector};
use arrayvec::ArrayVec;
use hapfic_messages::MAX_JOINTS;
use nalgebra::{Matrix3, Vector3};

/// Maximum number of speeds that a point depends on: those of two bodies, of which at most one is the leg.
const MAX_COLUMNS: usize = if MAX_JOINTS > 6 { MAX_JOINTS + 6 } else { 12 };

/// Contribution of one speed to the speeds at a point.
#[derive(Clone, Copy, Debug)]
struct JacobianColumn {
    /// Index of the speed.
    index: usize,
    /// Separation and the two components of slip, per unit of the speed.
    by: Vector3<f64>,
}

/// A contact point, or a joint at its stop, where there is no slip.
///
/// Speeds and forces have three components: along the normal (separation), and two across it (slip, friction).
#[derive(Clone, Debug)]
pub(crate) struct ConstraintPoint {
    /// Non-zero columns of the Jacobian, in the order of the speeds.
    columns: ArrayVec<JacobianColumn, MAX_COLUMNS>,
    /// Whether friction acts.
    has_friction: bool,
    /// Depth at the start of the sub-step [m].
    pub(crate) depth: f64,
    /// Contact law.
    pub(crate) law: ContactLaw,
}

impl ConstraintPoint {
    /// Creates a point that depends on no speed yet.
    pub(crate) fn new(depth: f64, law: ContactLaw) -> Self {
        Self { columns: ArrayVec::new(), has_friction: law.friction_static > 0.0, depth, law }
    }

    /// Adds the column of the speed `index`; the calls come in ascending order.
    pub(crate) fn add_column(&mut self, index: usize, by: Vector3<f64>) {
        debug_assert!(index < MAX_SPEEDS && self.columns.last().is_none_or(|last| last.index < index));
        self.columns.push(JacobianColumn { index, by });
    }

    /// Speeds at the point: `J v`.
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

    /// `matrix += J^T K J`, in the whole matrix; K may be any.
    pub(crate) fn add_exact_stiffness(&self, k: &Matrix3<f64>, matrix: &mut [VelocityVector; MAX_SPEEDS]) {
        for column in &self.columns {
            let force = k * column.by;
            for row in &self.columns {
                matrix[row.index][column.index] += row.by.dot(&force);
            }
        }
    }

    /// Depth and separation speed at the midpoint of a sub-step `h` [s], from the separation speeds at its ends.
    #[inline]
    fn midpoint(&self, h: f64, before: f64, after: f64) -> (f64, f64) {
        let speed = 0.5 * (before + after);
        (self.depth - 0.5 * h * speed, speed)
    }

    /// Force for the speeds `after` a sub-step of `h` [s] that began with the separation speed `before`.
    #[inline]
    pub(crate) fn force(&self, h: f64, before: f64, after: &Vector3<f64>) -> Vector3<f64> {
        let (depth, speed) = self.midpoint(h, before, after.x);
        let normal = self.law.normal(depth, -speed).force;
        if normal <= 0.0 {
            return Vector3::zeros();
        }
        if !self.has_friction {
            return Vector3::new(normal, 0.0, 0.0);
        }
        let slip = (after.y * after.y + after.z * after.z).sqrt();
        let secant = self.law.friction_per_speed(slip) * normal;
        Vector3::new(normal, -secant * after.y, -secant * after.z)
    }

    /// Negative derivative of the force by the speeds after the sub-step [N s/m]; `None` without force.
    ///
    /// Omits the falling branch of mu and the effect of the normal force on friction, and is thus symmetric and
    /// positive semidefinite.
    pub(crate) fn slope(&self, h: f64, before: f64, after: &Vector3<f64>) -> Option<Matrix3<f64>> {
        let (depth, speed) = self.midpoint(h, before, after.x);
        let normal = self.law.normal(depth, -speed);
        if normal.force <= 0.0 {
            return None;
        }
        let mut slope = Matrix3::zeros();
        slope.m11 = 0.5 * (normal.by_rate + 0.5 * h * normal.by_depth).max(0.0);
        if self.has_friction {
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

    /// The whole negative derivative of the force by the speeds after the sub-step [N s/m]; `None` without force.
    pub(crate) fn exact_slope(&self, h: f64, before: f64, after: &Vector3<f64>) -> Option<Matrix3<f64>> {
        let (depth, speed) = self.midpoint(h, before, after.x);
        let normal = self.law.normal(depth, -speed);
        if normal.force <= 0.0 {
            return None;
        }
        let mut slope = Matrix3::zeros();
        slope.m11 = 0.5 * (normal.by_rate + 0.5 * h * normal.by_depth);
        if self.has_friction {
            let slip = (after.y * after.y + after.z * after.z).sqrt();
            let secant = self.law.friction_per_speed(slip);
            let along = self.law.friction(slip).slope - secant;
            let (y, z) = if slip > 0.0 { (after.y / slip, after.z / slip) } else { (0.0, 0.0) };
            slope.m21 = -secant * after.y * slope.m11;
            slope.m31 = -secant * after.z * slope.m11;
            slope.m22 = normal.force * (secant + along * y * y);
            slope.m33 = normal.force * (secant + along * z * z);
            slope.m23 = normal.force * along * y * z;
            slope.m32 = slope.m23;
        }
        Some(slope)
    }
}
