//! Mass matrix, inverse dynamics and energies, all in world axes.
//!
//! The equations of motion are `M(q) q'' + bias(q, q') = tau + J^T F`.

use crate::chain::{Chain, MAX_JOINTS};
use crate::inertia::point_inertia;
use crate::kinematics::Kinematics;
use nalgebra::{Matrix3, SMatrix, Vector3};

/// Mass matrix [kg m^2, kg m or kg]: the upper left [`Chain::dof`] rows and columns; the rest is zero.
pub type MassMatrix<const W: usize = MAX_JOINTS> = SMatrix<f64, W, W>;

impl Chain {
    /// The mass matrix M(q): symmetric, positive definite.
    ///
    /// Composite rigid bodies: about a common point and along common axes, the inertias of all bodies that a joint
    /// moves add up.
    #[inline]
    #[must_use]
    pub fn mass_matrix<const W: usize>(&self, kin: &Kinematics<W>) -> MassMatrix<W> {
        // About the base, not the world's origin: a robot far from the origin must not lose precision.
        let point = self.base_position;
        // Per unit speed of joint i: angular velocity of the body behind it, and velocity of the body at the point.
        let motion: [(Vector3<f64>, Vector3<f64>); W] = std::array::from_fn(|i| {
            if kin.rotational[i] {
                (kin.axis[i], (kin.origin[i] - point).cross(&kin.axis[i]))
            } else {
                (Vector3::zeros(), kin.axis[i])
            }
        });
        let mut result = MassMatrix::<W>::zeros();
        let mut mass = 0.0;
        let mut first_moment: Vector3<f64> = Vector3::zeros();
        let mut inertia: Matrix3<f64> = Matrix3::zeros();
        for (j, body) in self.bodies.iter().enumerate().rev() {
            let own = &body.inertia;
            let rotation = &kin.rotation[j];
            let center = kin.center[j] - point;
            mass += own.mass_kg;
            first_moment += center * own.mass_kg;
            inertia += rotation * own.inertia_kg_m2 * rotation.transpose() + point_inertia(own.mass_kg, &center);

            let (angular, linear) = &motion[j];
            let momentum = linear * mass + angular.cross(&first_moment);
            let angular_momentum = inertia * angular + first_moment.cross(linear);
            for (i, (angular, linear)) in motion.iter().enumerate().take(j + 1) {
                let value = angular.dot(&angular_momentum) + linear.dot(&momentum);
                result[(i, j)] = value;
                result[(j, i)] = value;
            }
            result[(j, j)] += self.joints[j].armature;
        }
        result
    }

    /// Inverse dynamics: the generalised forces tau [N m or N] for the accelerations `qdd` at the velocities `qd`.
    ///
    /// Recursive Newton-Euler under gravity [m/s^2], such as (0, 0, -9.81), without contact and joint damping. Panics
    /// if a slice is shorter than [`Chain::dof`].
    #[inline]
    #[must_use]
    pub fn inverse_dynamics<const W: usize>(
        &self,
        kin: &Kinematics<W>,
        qd: &[f64],
        qdd: &[f64],
        gravity: &Vector3<f64>,
    ) -> [f64; W] {
        let n = self.bodies.len();
        let mut force: [Vector3<f64>; W] = [Vector3::zeros(); W];
        let mut moment: [Vector3<f64>; W] = [Vector3::zeros(); W];
        let mut angular_velocity: Vector3<f64> = Vector3::zeros();
        let mut angular_acceleration: Vector3<f64> = Vector3::zeros();
        // Gravity is equivalent to an upward acceleration of the base.
        let mut acceleration: Vector3<f64> = -gravity;
        let mut previous = self.base_position;
        for (i, (body, (&rate, &rate_change))) in self.bodies.iter().zip(qd[..n].iter().zip(&qdd[..n])).enumerate() {
            let axis = kin.axis[i];
            let offset = kin.origin[i] - previous;
            previous = kin.origin[i];
            acceleration += angular_acceleration.cross(&offset) + angular_velocity.cross(&angular_velocity.cross(&offset));
            if kin.rotational[i] {
                angular_acceleration += axis * rate_change + angular_velocity.cross(&axis) * rate;
                angular_velocity += axis * rate;
            } else {
                acceleration += axis * rate_change + angular_velocity.cross(&axis) * (2.0 * rate);
            }

            let own = &body.inertia;
            let center = kin.center[i] - kin.origin[i];
            let at_center =
                acceleration + angular_acceleration.cross(&center) + angular_velocity.cross(&angular_velocity.cross(&center));
            // The inertia is constant in the body's axes: rotating two vectors into them and one back is cheaper.
            let rotation = &kin.rotation[i];
            let local_velocity = rotation.tr_mul(&angular_velocity);
            let local_acceleration = rotation.tr_mul(&angular_acceleration);
            let spin = own.inertia_kg_m2 * local_acceleration + local_velocity.cross(&(own.inertia_kg_m2 * local_velocity));
            force[i] = at_center * own.mass_kg;
            moment[i] = rotation * spin + center.cross(&force[i]);
        }

        let mut torque = [0.0; W];
        let mut total_force: Vector3<f64> = Vector3::zeros();
        let mut total_moment: Vector3<f64> = Vector3::zeros();
        let mut next: Vector3<f64> = Vector3::zeros();
        for i in (0..n).rev() {
            total_moment += (next - kin.origin[i]).cross(&total_force) + moment[i];
            total_force += force[i];
            next = kin.origin[i];
            torque[i] = kin.axis[i].dot(if kin.rotational[i] { &total_moment } else { &total_force });
            torque[i] += self.joints[i].armature * qdd[i];
        }
        torque
    }

    /// Coriolis, centrifugal and gravity terms: inverse dynamics without acceleration [N m or N].
    #[inline]
    #[must_use]
    pub fn bias<const W: usize>(&self, kin: &Kinematics<W>, qd: &[f64], gravity: &Vector3<f64>) -> [f64; W] {
        self.inverse_dynamics(kin, qd, &[0.0; MAX_JOINTS], gravity)
    }

    /// g(q): the generalised forces [N m or N] that hold the chain at rest under gravity [m/s^2].
    #[inline]
    #[must_use]
    pub fn gravity_torque<const W: usize>(&self, kin: &Kinematics<W>, gravity: &Vector3<f64>) -> [f64; W] {
        let mut torque = [0.0; W];
        let mut mass = 0.0;
        let mut first_moment: Vector3<f64> = Vector3::zeros();
        for (i, body) in self.bodies.iter().enumerate().rev() {
            // About the base, for precision, as above.
            mass += body.inertia.mass_kg;
            first_moment += (kin.center[i] - self.base_position) * body.inertia.mass_kg;
            torque[i] = if kin.rotational[i] {
                let arm = first_moment - (kin.origin[i] - self.base_position) * mass;
                -kin.axis[i].dot(&arm.cross(gravity))
            } else {
                -kin.axis[i].dot(gravity) * mass
            };
        }
        torque
    }

    /// Kinetic energy of all bodies [J]. Panics if `qd` is shorter than [`Chain::dof`].
    #[inline]
    #[must_use]
    pub fn kinetic_energy<const W: usize>(&self, kin: &Kinematics<W>, qd: &[f64]) -> f64 {
        let mut energy = 0.0;
        let mut angular_velocity: Vector3<f64> = Vector3::zeros();
        let mut velocity: Vector3<f64> = Vector3::zeros();
        let mut previous = self.base_position;
        for (i, (body, &rate)) in self.bodies.iter().zip(&qd[..self.bodies.len()]).enumerate() {
            velocity += angular_velocity.cross(&(kin.origin[i] - previous));
            previous = kin.origin[i];
            if kin.rotational[i] {
                angular_velocity += kin.axis[i] * rate;
            } else {
                velocity += kin.axis[i] * rate;
            }
            let own = &body.inertia;
            let at_center = velocity + angular_velocity.cross(&(kin.center[i] - kin.origin[i]));
            let local = kin.rotation[i].tr_mul(&angular_velocity);
            energy += 0.5 * (own.mass_kg * at_center.norm_squared() + local.dot(&(own.inertia_kg_m2 * local)));
            energy += 0.5 * self.joints[i].armature * rate * rate;
        }
        energy
    }

    /// Potential energy of all bodies [J] under gravity [m/s^2]; zero with the mass at the world's origin.
    #[inline]
    #[must_use]
    pub fn potential_energy<const W: usize>(&self, kin: &Kinematics<W>, gravity: &Vector3<f64>) -> f64 {
        let mut energy = 0.0;
        for (body, center) in self.bodies.iter().zip(&kin.center) {
            energy -= body.inertia.mass_kg * gravity.dot(center);
        }
        energy
    }
}
