//! Vectors and poses for drawing.

/// Vector [m].
pub(crate) type Vector = [f64; 3];

/// Pose of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pose {
    /// Position [m].
    pub(crate) position: Vector,
    /// Unit quaternion x y z w.
    pub(crate) orientation: [f64; 4],
}

impl Pose {
    pub(crate) const WORLD: Self = Self { position: [0.0; 3], orientation: [0.0, 0.0, 0.0, 1.0] };

    /// Transforms a point of the body to the world.
    pub(crate) fn point(&self, point: Vector) -> Vector {
        add(self.position, rotate(self.orientation, point))
    }

    /// Transforms a pose in the body to the world.
    pub(crate) fn pose(&self, inner: &Self) -> Self {
        let [ax, ay, az, aw] = self.orientation;
        let [bx, by, bz, bw] = inner.orientation;
        Self {
            position: self.point(inner.position),
            orientation: [
                aw * bx + ax * bw + ay * bz - az * by,
                aw * by - ax * bz + ay * bw + az * bx,
                aw * bz + ax * by - ay * bx + az * bw,
                aw * bw - ax * bx - ay * by - az * bz,
            ],
        }
    }
}

pub(crate) fn add(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(crate) fn scale(a: Vector, factor: f64) -> Vector {
    a.map(|v| v * factor)
}

pub(crate) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn norm(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

/// Normalizes a vector; z without a direction.
pub(crate) fn unit(a: Vector) -> Vector {
    let length = norm(a);
    if length > 1e-12 { scale(a, 1.0 / length) } else { [0.0, 0.0, 1.0] }
}

/// Rotates a vector by a unit quaternion x y z w.
pub(crate) fn rotate(q: [f64; 4], v: Vector) -> Vector {
    let axis = [q[0], q[1], q[2]];
    let t = scale(cross(axis, v), 2.0);
    add(add(v, scale(t, q[3])), cross(axis, t))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pose_quarter_rotation_about_z_maps_x_to_y() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let quarter = Pose { position: [1.0, 0.0, 0.0], orientation: [0.0, 0.0, half, half] };
        let near = |a: Vector, b: Vector| norm(add(a, scale(b, -1.0))) < 1e-12;
        assert!(near(quarter.point([1.0, 0.0, 0.0]), [1.0, 1.0, 0.0]));
        let half_rotation = quarter.pose(&quarter);
        assert!(near(half_rotation.point([1.0, 0.0, 0.0]), [0.0, 1.0, 0.0]));
    }
}
