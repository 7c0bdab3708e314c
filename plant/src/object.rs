//! Free body: state, inertia, and motion without contact.

use hapfic_config::{Object, ObjectShape};
use hapfic_messages::ObjectState;
use nalgebra::{Matrix3, Quaternion, Translation3, UnitQuaternion, Vector3};

/// Iterations of a turn that keeps the energy, at most; each leaves less than a tenth below 0.1 rad a sub-step.
const MAX_TURN_ITERATIONS: u32 = 20;
/// Relative change of the mean angular velocity at which they end.
const TURN_TOLERANCE: f64 = 1e-15;

/// A box or a ball of even density.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeBody {
    /// Centre of mass [m].
    pub position: Vector3<f64>,
    /// Orientation, from the body's axes to the world's.
    pub rotation: UnitQuaternion<f64>,
    /// Velocity of the centre [m/s].
    pub velocity: Vector3<f64>,
    /// Angular velocity in the world frame [rad/s].
    pub angular_velocity: Vector3<f64>,
    /// Mass [kg].
    pub mass: f64,
    /// Principal moments about the centre, along the body's axes [kg m^2].
    pub inertia: Vector3<f64>,
}

impl FreeBody {
    /// Creates a body at rest at the pose of the scenario.
    pub(crate) fn new(object: &Object) -> Self {
        let m = object.mass_kg;
        let inertia = match object.shape {
            ObjectShape::Box { size_m: [a, b, c] } => Vector3::new(b * b + c * c, a * a + c * c, a * a + b * b) * (m / 12.0),
            ObjectShape::Ball { radius_m } => Vector3::repeat(0.4 * m * radius_m * radius_m),
        };
        let [roll, pitch, yaw] = object.orientation_rpy_rad;
        Self {
            position: Vector3::from(object.position_m),
            rotation: UnitQuaternion::from_euler_angles(roll, pitch, yaw),
            velocity: Vector3::zeros(),
            angular_velocity: Vector3::zeros(),
            mass: m,
            inertia,
        }
    }

    /// Pose of the body's frame.
    #[must_use]
    pub fn pose(&self) -> nalgebra::Isometry3<f64> {
        nalgebra::Isometry3::from_parts(Translation3::from(self.position), self.rotation)
    }

    /// State for the `/state` message.
    #[must_use]
    pub fn state(&self) -> ObjectState {
        let q = self.rotation;
        ObjectState {
            position: self.position.into(),
            orientation: [q.i, q.j, q.k, q.w],
            linear_velocity: self.velocity.into(),
            angular_velocity: self.angular_velocity.into(),
        }
    }

    /// Restores a published pose and velocity.
    pub(crate) fn resume(&mut self, at: &ObjectState) {
        let [i, j, k, w] = at.orientation;
        self.position = at.position.into();
        // Bit for bit: normalising could change the last bits.
        self.rotation = UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(w, i, j, k));
        self.velocity = at.linear_velocity.into();
        self.angular_velocity = at.angular_velocity.into();
    }

    /// Inertia along the axes of the world [kg m^2].
    #[must_use]
    pub fn world_inertia(&self) -> Matrix3<f64> {
        let r = self.rotation.to_rotation_matrix();
        r * Matrix3::from_diagonal(&self.inertia) * r.transpose()
    }

    /// Angular momentum L, world frame [kg m^2/s].
    #[must_use]
    pub fn angular_momentum(&self) -> Vector3<f64> {
        self.rotation * self.inertia.component_mul(&(self.rotation.inverse() * self.angular_velocity))
    }

    /// Angular velocity of an angular momentum at an orientation.
    fn angular_velocity_of(&self, rotation: &UnitQuaternion<f64>, momentum: &Vector3<f64>) -> Vector3<f64> {
        rotation * (rotation.inverse() * momentum).component_div(&self.inertia)
    }

    /// Kinetic and potential energy [J].
    #[must_use]
    pub fn energy(&self, gravity: &Vector3<f64>) -> f64 {
        0.5 * self.mass * self.velocity.norm_squared() + 0.5 * self.angular_velocity.dot(&self.angular_momentum())
            - self.mass * gravity.dot(&self.position)
    }

    /// Moves without contact for `h` [s].
    ///
    /// The centre follows a parabola. The rotation keeps the angular momentum, which includes the gyroscopic torque;
    /// the fourth-order Runge-Kutta method integrates the orientation.
    pub(crate) fn free_step(&mut self, gravity: &Vector3<f64>, h: f64) {
        self.position += h * (self.velocity + 0.5 * h * gravity);
        self.velocity += h * gravity;
        let momentum = self.angular_momentum();
        let q0 = self.rotation.into_inner();
        // q' = omega q / 2, with omega a function of q alone.
        let rate = |q: &Quaternion<f64>| {
            let omega = self.angular_velocity_of(&UnitQuaternion::new_normalize(*q), &momentum);
            Quaternion::from_parts(0.0, omega) * q * 0.5
        };
        let k1 = rate(&q0);
        let k2 = rate(&(q0 + k1 * (0.5 * h)));
        let k3 = rate(&(q0 + k2 * (0.5 * h)));
        let k4 = rate(&(q0 + k3 * h));
        self.rotation = UnitQuaternion::new_normalize(q0 + (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0));
        self.angular_velocity = self.angular_velocity_of(&self.rotation, &momentum);
    }

    /// Moves for `h` [s] to the velocities that the contact solver found; returns the energy that the turn adds by
    /// mistake [J].
    ///
    /// `solved` is an angular velocity under the inertia of the start, and thus gives the angular momentum. The
    /// orientation follows by the midpoint rule at that momentum.
    pub(crate) fn apply_contact_velocities(&mut self, velocity: Vector3<f64>, solved: Vector3<f64>, h: f64) -> f64 {
        self.position += 0.5 * h * (self.velocity + velocity);
        self.velocity = velocity;
        let before = self.angular_momentum();
        let after = self.world_inertia() * solved;
        let half = UnitQuaternion::from_scaled_axis(0.5 * h * self.angular_velocity) * self.rotation;
        let midpoint = self.angular_velocity_of(&half, &(0.5 * (before + after)));
        self.rotation =
            UnitQuaternion::new_normalize((UnitQuaternion::from_scaled_axis(h * midpoint) * self.rotation).into_inner());
        self.angular_velocity = self.angular_velocity_of(&self.rotation, &after);
        0.5 * (self.angular_velocity - solved).dot(&after)
    }

    /// Moves as [`apply_contact_velocities`](Self::apply_contact_velocities), by a turn that adds no energy; returns
    /// the turn as a rotation vector [rad].
    ///
    /// The body turns by the mean of its angular velocities before and after, both along its own axes (the
    /// energy-momentum rule of Simo and Wong). A turn about that mean leaves the energy of a constant angular momentum
    /// alone, so that the energy changes by the work of the contacts' torque over the turn, at any `h`.
    pub(crate) fn apply_keeping_energy(&mut self, velocity: Vector3<f64>, solved: Vector3<f64>, h: f64) -> Vector3<f64> {
        self.position += 0.5 * h * (self.velocity + velocity);
        self.velocity = velocity;
        let after = self.world_inertia() * solved;
        let start = self.rotation;
        let along = |rotation: &UnitQuaternion<f64>, momentum: &Vector3<f64>| {
            (rotation.inverse() * momentum).component_div(&self.inertia)
        };
        let before = along(&start, &self.angular_momentum());
        let mut mean = along(&start, &(0.5 * (self.angular_momentum() + after)));
        for _ in 0..MAX_TURN_ITERATIONS {
            let turned = start * UnitQuaternion::from_scaled_axis(h * mean);
            let next = 0.5 * (before + along(&turned, &after));
            let change = (next - mean).norm();
            mean = next;
            if change <= TURN_TOLERANCE * mean.norm() {
                break;
            }
        }
        let turn = start * (h * mean);
        self.rotation = UnitQuaternion::new_normalize((start * UnitQuaternion::from_scaled_axis(h * mean)).into_inner());
        self.angular_velocity = self.angular_velocity_of(&self.rotation, &after);
        turn
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn brick() -> FreeBody {
        let rotation = UnitQuaternion::from_euler_angles(0.3, -0.2, 0.9);
        FreeBody {
            position: Vector3::zeros(),
            rotation,
            velocity: Vector3::new(0.1, -0.2, 3.0),
            angular_velocity: rotation * Vector3::new(0.02, 7.0, 0.03),
            mass: 2.0,
            inertia: Vector3::new(0.01, 0.02, 0.03),
        }
    }

    #[test]
    fn free_body_flight_keeps_energy_and_momentum() {
        // Rotation about the intermediate axis is unstable: the brick flips.
        let (mut body, gravity) = (brick(), Vector3::new(0.0, 0.0, -9.81));
        let (energy, momentum) = (body.energy(&gravity), body.angular_momentum());
        let axis = body.rotation.inverse() * body.angular_velocity.normalize();
        let mut flipped = false;
        for _ in 0..50_000 {
            body.free_step(&gravity, 1e-4);
            flipped |= (body.rotation.inverse() * body.angular_velocity.normalize()).dot(&axis) < -0.9;
        }
        assert!(flipped, "the brick does not flip: no gyroscopic torque");
        assert!((body.angular_momentum() - momentum).norm() < 1e-9 * momentum.norm());
        assert!((body.energy(&gravity) / energy - 1.0).abs() < 1e-9);
        assert!((body.velocity.z - (3.0 - 9.81 * 5.0)).abs() < 1e-9);
        assert!((body.position.z - (3.0 * 5.0 - 0.5 * 9.81 * 25.0)).abs() < 1e-9);
    }

    #[test]
    fn free_body_contact_step_rotates_as_flight() {
        let (mut pushed, mut flown) = (brick(), brick());
        let h = 2e-5;
        for _ in 0..10_000 {
            let (velocity, solved) = (pushed.velocity, pushed.angular_velocity);
            pushed.apply_contact_velocities(velocity, solved, h);
            flown.free_step(&Vector3::zeros(), h);
        }
        assert!(pushed.rotation.angle_to(&flown.rotation) < 1e-6, "{}", pushed.rotation.angle_to(&flown.rotation));
        assert!((pushed.position - flown.position).norm() < 1e-12);
    }

    #[test]
    fn free_body_symmetric_top_precesses() {
        // Symmetric about z: the axis circles the angular momentum at L / I_x.
        let mut body = FreeBody {
            rotation: UnitQuaternion::identity(),
            angular_velocity: Vector3::new(1.0, 0.0, 20.0),
            inertia: Vector3::new(0.02, 0.02, 0.03),
            ..brick()
        };
        let momentum = body.angular_momentum();
        let period = std::f64::consts::TAU / (momentum.norm() / 0.02);
        let axis = Vector3::z();
        let steps = 2000;
        for _ in 0..steps {
            body.free_step(&Vector3::zeros(), period / f64::from(steps));
        }
        assert!((body.rotation * axis - axis).norm() < 1e-8);
    }
}
