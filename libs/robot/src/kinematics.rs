//! Forward kinematics: poses of all bodies of a chain.

use crate::chain::{Chain, ChainBody, MAX_JOINTS, isometry};
use crate::jacobian::Jacobian;
use nalgebra::{Isometry3, Matrix3, Vector3};

/// Poses, axes and centres of a chain at one joint position, world frame: the input of all other functions.
///
/// Arrays have `W` entries; those beyond the chain's joints are zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kinematics<const W: usize = MAX_JOINTS> {
    pub(crate) n: usize,
    pub(crate) rotational: [bool; W],
    pub(crate) axis: [Vector3<f64>; W],
    pub(crate) origin: [Vector3<f64>; W],
    pub(crate) rotation: [Matrix3<f64>; W],
    pub(crate) center: [Vector3<f64>; W],
    tip_position: Vector3<f64>,
    tip_rotation: Matrix3<f64>,
}

impl Chain {
    /// Forward kinematics at joint positions `q` [rad or m]. Limits are not applied.
    ///
    /// Panics if `q` is shorter than [`Chain::dof`]; ignores further values.
    #[inline]
    #[must_use]
    pub fn kinematics(&self, q: &[f64]) -> Kinematics {
        self.kinematics_within(q)
    }

    /// [`Chain::kinematics`] in arrays of `W` entries: the same numbers, sooner for a short chain.
    ///
    /// Panics if `q` is shorter than [`Chain::dof`], or `W` is less.
    #[inline]
    #[must_use]
    pub fn kinematics_within<const W: usize>(&self, q: &[f64]) -> Kinematics<W> {
        let n = self.bodies.len();
        let mut kin = Kinematics {
            n,
            rotational: [false; W],
            axis: [Vector3::zeros(); W],
            origin: [Vector3::zeros(); W],
            rotation: [Matrix3::zeros(); W],
            center: [Vector3::zeros(); W],
            tip_position: Vector3::zeros(),
            tip_rotation: Matrix3::zeros(),
        };
        let (origin, rotation) = self.walk(q, |i, body, axis, origin, rotation| {
            kin.rotational[i] = body.rotational;
            kin.axis[i] = axis;
            kin.origin[i] = origin;
            kin.rotation[i] = rotation;
            kin.center[i] = origin + rotation * body.inertia.center_m;
        });
        kin.tip_position = origin + rotation * self.tip_position;
        kin.tip_rotation = rotation * self.tip_rotation;
        kin
    }

    /// Calls `visit` for each body from the base on, with its joint's axis, its origin and its rotation at `q`. Returns
    /// origin and rotation of the last one.
    #[inline]
    pub(crate) fn walk(
        &self,
        q: &[f64],
        mut visit: impl FnMut(usize, &ChainBody, Vector3<f64>, Vector3<f64>, Matrix3<f64>),
    ) -> (Vector3<f64>, Matrix3<f64>) {
        let mut rotation = self.base_rotation;
        let mut origin = self.base_position;
        for (i, (body, &position)) in self.bodies.iter().zip(&q[..self.bodies.len()]).enumerate() {
            let axis = rotation * body.axis;
            origin += rotation * body.joint_position;
            let local = if body.rotational {
                let (sin, cos) = position.sin_cos();
                body.joint_rotation + body.joint_rotation_sin * sin + body.joint_rotation_versin * (1.0 - cos)
            } else {
                origin += axis * position;
                body.joint_rotation
            };
            let turned = rotation * local;
            rotation = turned;
            visit(i, body, axis, origin, rotation);
        }
        (origin, rotation)
    }

    /// Geometric Jacobian of the tip, linear and angular, world frame.
    #[inline]
    #[must_use]
    pub fn jacobian<const W: usize>(&self, kin: &Kinematics<W>) -> Jacobian<W> {
        kin.point_jacobian(self.dof() - 1, &kin.tip_position)
    }
}

impl<const W: usize> Kinematics<W> {
    /// Number of movable joints.
    #[inline]
    #[must_use]
    pub fn dof(&self) -> usize {
        self.n
    }

    /// Position of the tip frame [m]: the paper's x.
    #[inline]
    #[must_use]
    pub fn tip_position(&self) -> Vector3<f64> {
        self.tip_position
    }

    /// Orientation of the tip frame: a rotation matrix, tip to world.
    #[inline]
    #[must_use]
    pub fn tip_rotation(&self) -> Matrix3<f64> {
        self.tip_rotation
    }

    /// Axis of joint `i`, a unit vector.
    ///
    /// Panics if `i` is not below `W`.
    #[inline]
    #[must_use]
    pub fn joint_axis(&self, i: usize) -> Vector3<f64> {
        self.axis[i]
    }

    /// Origin of body `i` [m]: the position of joint `i`, with the displacement of a prismatic joint.
    ///
    /// Panics if `i` is not below `W`.
    #[inline]
    #[must_use]
    pub fn body_origin(&self, i: usize) -> Vector3<f64> {
        self.origin[i]
    }

    /// Orientation of body `i`: a rotation matrix, body to world.
    ///
    /// Panics if `i` is not below `W`.
    #[inline]
    #[must_use]
    pub fn body_rotation(&self, i: usize) -> Matrix3<f64> {
        self.rotation[i]
    }

    /// Centre of mass of body `i` [m].
    ///
    /// Panics if `i` is not below `W`.
    #[inline]
    #[must_use]
    pub fn body_center(&self, i: usize) -> Vector3<f64> {
        self.center[i]
    }

    /// Pose of body `i`, the link that joint `i` moves [m].
    ///
    /// Panics if `i` is not below `W`.
    #[inline]
    #[must_use]
    pub fn body_pose(&self, i: usize) -> Isometry3<f64> {
        isometry(&self.rotation[i], &self.origin[i])
    }

    /// Geometric Jacobian of the point fixed to a body that is now at `point` in the world [m].
    ///
    /// Columns of joints beyond the body are zero. Panics if `body` is not below [`Kinematics::dof`].
    #[inline]
    #[must_use]
    pub fn point_jacobian(&self, body: usize, point: &Vector3<f64>) -> Jacobian<W> {
        assert!(body < self.n, "body {body} of a chain of {} joints", self.n);
        let mut jacobian = Jacobian { n: self.n, linear: [Vector3::zeros(); W], angular: [Vector3::zeros(); W] };
        for (i, axis) in self.axis.iter().enumerate().take(body + 1) {
            if self.rotational[i] {
                jacobian.linear[i] = axis.cross(&(point - self.origin[i]));
                jacobian.angular[i] = *axis;
            } else {
                jacobian.linear[i] = *axis;
            }
        }
        jacobian
    }

    /// Whether all values are finite: false if any joint position is not.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        // A joint position that is not finite makes every orientation behind a rotational joint, or every position
        // behind a prismatic one, not finite: it always reaches the tip.
        self.tip_position.iter().chain(self.tip_rotation.iter()).all(|value| value.is_finite())
    }
}
