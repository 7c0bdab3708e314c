//! Rotation and displacement of the free bodies.

use super::label::{Label, List};
use super::moments::ObjectSummary;
use super::sample::ObjectSample;
use hapfic_messages::MAX_OBJECTS;

/// Angle between a body's first and present z axis from which it lies on another face [rad]: 80 degrees.
const TIPPED_RAD: f64 = 80.0 * std::f64::consts::PI / 180.0;
/// Speeds below which a body is at rest, both together [m/s] and [rad/s].
const REST_M_PER_S: f64 = 1e-3;
const REST_RAD_PER_S: f64 = 1e-2;
/// Duration of rest that counts [ticks].
const REST_TICKS: u64 = 200;

/// The free bodies, by name.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Objects {
    bodies: List<Body, MAX_OBJECTS>,
}

/// One free body.
#[derive(Clone, Copy, Debug, Default)]
struct Body {
    name: Label,
    start_position: [f64; 3],
    start_orientation: [f64; 4],
    rotation: f64,
    largest_rotation: f64,
    largest_displacement: f64,
    /// Ticks of rest on another face so far.
    tipped: u64,
    tipped_at_rest: bool,
}

impl Objects {
    pub(super) fn tick(&mut self, objects: &[ObjectSample]) {
        for object in objects {
            let start = || Body {
                name: object.name,
                start_position: object.position,
                start_orientation: object.orientation,
                ..Body::default()
            };
            if let Some(body) = self.bodies.entry(|body| body.name == object.name, start) {
                body.tick(object);
            }
        }
    }

    pub(super) fn summary(&self) -> List<ObjectSummary, MAX_OBJECTS> {
        let summary = |body: &Body| ObjectSummary {
            name: body.name,
            max_turn_deg: body.largest_rotation.to_degrees(),
            final_turn_deg: body.rotation.to_degrees(),
            tipped_at_rest: body.tipped_at_rest,
            max_displacement_m: body.largest_displacement,
        };
        self.bodies.iter().map(summary).collect()
    }
}

impl Body {
    fn tick(&mut self, object: &ObjectSample) {
        self.rotation = angle_between(self.start_orientation, object.orientation);
        self.largest_rotation = self.largest_rotation.max(self.rotation);
        let displacement: [f64; 3] = std::array::from_fn(|i| object.position[i] - self.start_position[i]);
        self.largest_displacement = self.largest_displacement.max(norm(displacement));
        let at_rest = norm(object.linear_velocity) < REST_M_PER_S && norm(object.angular_velocity) < REST_RAD_PER_S;
        let (then, now) = (z_axis(self.start_orientation), z_axis(object.orientation));
        let tipped = norm(cross(then, now)).atan2(dot(then, now)) >= TIPPED_RAD;
        self.tipped = if at_rest && tipped { self.tipped + 1 } else { 0 };
        self.tipped_at_rest |= self.tipped >= REST_TICKS;
    }
}

/// Returns the angle of rotation from orientation `a` to `b`, 0 to pi [rad]; quaternions are x y z w.
///
/// Exact near 0 too, unlike the arc cosine.
#[must_use]
pub fn angle_between(a: [f64; 4], b: [f64; 4]) -> f64 {
    let (u, v) = ([a[0], a[1], a[2]], [b[0], b[1], b[2]]);
    let across = cross(u, v);
    let vector: [f64; 3] = std::array::from_fn(|i| a[3] * v[i] - b[3] * u[i] - across[i]);
    let scalar = a[3] * b[3] + dot(u, v);
    2.0 * norm(vector).atan2(scalar.abs())
}

/// Direction of a body's z axis, given its unit quaternion.
fn z_axis([x, y, z, w]: [f64; 4]) -> [f64; 3] {
    [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn norm(v: [f64; 3]) -> f64 {
    dot(v, v).sqrt()
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
        assert!(norm(cross(z_axis(about_x(0.5)), [0.0, (-0.5_f64).sin(), 0.5_f64.cos()])) < 1e-15);
    }
}
