//! Mass, centre of mass and inertia of a rigid body, and the sum of bodies fixed to each other.

use nalgebra::{IsometryMatrix3, Matrix3, Vector3};

/// Mass, centre of mass and inertia of a rigid body in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidInertia {
    /// Mass [kg]; zero or more.
    pub mass_kg: f64,
    /// Centre of mass in the body's frame [m].
    pub center_m: Vector3<f64>,
    /// Inertia about the centre of mass along the axes of the body's frame [kg m^2]; symmetric, 3x3.
    pub inertia_kg_m2: Matrix3<f64>,
}

impl RigidInertia {
    /// The inertia of a body without mass.
    pub(crate) fn zero() -> Self {
        Self { mass_kg: 0.0, center_m: Vector3::zeros(), inertia_kg_m2: Matrix3::zeros() }
    }

    /// The same body seen from a frame in which its own frame is at `pose`.
    pub(crate) fn placed(&self, pose: &IsometryMatrix3<f64>) -> Self {
        let rotation = pose.rotation.matrix();
        Self {
            mass_kg: self.mass_kg,
            center_m: rotation * self.center_m + pose.translation.vector,
            inertia_kg_m2: rotation * self.inertia_kg_m2 * rotation.transpose(),
        }
    }

    /// Inertia of this body and another one, fixed to each other; both in the same frame.
    pub(crate) fn plus(&self, other: &Self) -> Self {
        let mass_kg = self.mass_kg + other.mass_kg;
        let center_m = if mass_kg > 0.0 {
            (self.center_m * self.mass_kg + other.center_m * other.mass_kg) / mass_kg
        } else {
            Vector3::zeros()
        };
        let about_common_center = |body: &Self| body.inertia_kg_m2 + point_inertia(body.mass_kg, &(body.center_m - center_m));
        Self { mass_kg, center_m, inertia_kg_m2: about_common_center(self) + about_common_center(other) }
    }

    /// Moment of inertia about an axis (unit vector) through the origin of the body's frame [kg m^2].
    pub(crate) fn about_axis(&self, axis: &Vector3<f64>) -> f64 {
        let about_origin = self.inertia_kg_m2 + point_inertia(self.mass_kg, &self.center_m);
        axis.dot(&(about_origin * axis))
    }
}

/// Inertia of a point mass at `offset` about the origin [kg m^2].
#[inline]
pub(crate) fn point_inertia(mass: f64, offset: &Vector3<f64>) -> Matrix3<f64> {
    (Matrix3::<f64>::identity() * offset.norm_squared() - offset * offset.transpose()) * mass
}
