//! Rotation and displacement of the free bodies.

use super::label::FixedList;
use super::moments::ObjectSummary;
use super::sample::ObjectSample;
use hapfic_messages::MAX_OBJECTS;
use nalgebra::{UnitQuaternion, Vector3};

/// Angle between a body's first and present z axis from which it lies on another face [rad]: 80 degrees.
const TIPPED_RAD: f64 = 80.0 * std::f64::consts::PI / 180.0;
/// Speeds below which a body is at rest, both together [m/s] and [rad/s].
const REST_M_PER_S: f64 = 1e-3;
const REST_RAD_PER_S: f64 = 1e-2;
/// Duration of rest that counts [ticks].
const REST_TICKS: u64 = 200;

/// Motions of the free bodies, by name.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ObjectMotions {
    motions: FixedList<ObjectMotion, MAX_OBJECTS>,
}

/// Motion of a free body.
#[derive(Clone, Copy, Debug, Default)]
struct ObjectMotion {
    start: ObjectSample,
    rotation: f64,
    largest_rotation: f64,
    largest_displacement: f64,
    /// Ticks of rest on another face so far.
    tipped: u64,
    tipped_at_rest: bool,
}

impl ObjectMotions {
    pub(super) fn tick(&mut self, objects: &[ObjectSample]) {
        for object in objects {
            let start = || ObjectMotion { start: *object, ..ObjectMotion::default() };
            if let Some(body) = self.motions.entry(|body| body.start.name == object.name, start) {
                body.tick(object);
            }
        }
    }

    pub(super) fn summary(&self) -> FixedList<ObjectSummary, MAX_OBJECTS> {
        let summary = |body: &ObjectMotion| ObjectSummary {
            name: body.start.name,
            max_turn_deg: body.largest_rotation.to_degrees(),
            final_turn_deg: body.rotation.to_degrees(),
            tipped_at_rest: body.tipped_at_rest,
            max_displacement_m: body.largest_displacement,
        };
        self.motions.iter().map(summary).collect()
    }
}

impl ObjectMotion {
    fn tick(&mut self, object: &ObjectSample) {
        self.rotation = self.start.orientation.angle_to(&object.orientation);
        self.largest_rotation = self.largest_rotation.max(self.rotation);
        self.largest_displacement = self.largest_displacement.max((object.position - self.start.position).norm());
        let at_rest = object.linear_velocity.norm() < REST_M_PER_S && object.angular_velocity.norm() < REST_RAD_PER_S;
        let [then, now] = [&self.start, object].map(|body| body.orientation * Vector3::z());
        let tipped = then.angle(&now) >= TIPPED_RAD;
        self.tipped = if at_rest && tipped { self.tipped + 1 } else { 0 };
        self.tipped_at_rest |= self.tipped >= REST_TICKS;
    }
}

/// Returns the angle of rotation between two orientations, 0 to pi [rad]; quaternions are x y z w.
#[must_use]
pub fn angle_between(a: [f64; 4], b: [f64; 4]) -> f64 {
    // The angle does not depend on the norms.
    let [a, b] = [a, b].map(|q| UnitQuaternion::new_unchecked(q.into()));
    a.angle_to(&b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angle_between_either_quaternion_sign_is_rotation_angle() {
        let about_x = |angle: f64| [(0.5 * angle).sin(), 0.0, 0.0, (0.5 * angle).cos()];
        for (from, to) in [(0.3, 0.3), (0.3, 0.3 + 1e-9), (-1.0, 1.5), (0.0, 3.0)] {
            let negative = about_x(to).map(|part| -part);
            for to_as in [about_x(to), negative] {
                let angle = angle_between(about_x(from), to_as);
                assert!((angle - (to - from)).abs() < 1e-14, "{angle}, expected {}", to - from);
            }
        }
    }
}
