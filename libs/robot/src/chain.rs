//! The model itself: joints, bodies, collision shapes and where the base stands.

use crate::collision::Collision;
use crate::inertia::RigidInertia;
use crate::kinematics::Kinematics;
use arrayvec::ArrayVec;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Most movable joints of a chain.
pub const MAX_JOINTS: usize = 8;

/// One number a joint; the first [`Chain::dof`] count.
pub type JointVector = [f64; MAX_JOINTS];

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Turns between limits.
    Revolute,
    /// Turns without limits.
    Continuous,
    /// Slides between limits.
    Prismatic,
}

/// What the description says of a movable joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name in the URDF.
    pub name: String,
    /// Name of the link it moves.
    pub child_link: String,
    /// How it moves.
    pub kind: JointKind,
    /// Lower limit, rad or m; finite, or minus infinity for a continuous joint.
    pub lower: f64,
    /// Upper limit, rad or m; finite and not below `lower`, or infinity for a continuous joint.
    pub upper: f64,
    /// Peak torque, N m, or force, N; finite, above zero.
    pub effort: f64,
    /// Speed limit, rad/s or m/s; zero or more, infinite where URDF 1.2 omits it.
    pub velocity_limit: f64,
    /// Viscous damping, N m s/rad or N s/m; finite, zero or more.
    pub damping: f64,
}

/// The numbers of a movable joint and of the body behind it, up to the next movable joint.
///
/// The body's frame is that of the joint's child link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Body {
    /// Turns (revolute, continuous) rather than slides.
    pub(crate) rotational: bool,
    /// Place of the joint in the frame of the body before.
    pub(crate) joint_position: Vector3<f64>,
    /// Orientation of the joint in the frame of the body before, R.
    pub(crate) joint_rotation: Matrix3<f64>,
    /// R K, K the cross-product matrix of the axis: R (1 + sin K + (1 - cos) K^2) is the turned frame (Rodrigues).
    pub(crate) joint_rotation_sin: Matrix3<f64>,
    /// R K^2.
    pub(crate) joint_rotation_versin: Matrix3<f64>,
    /// Axis (unit vector) in the frame of the body before.
    pub(crate) axis: Vector3<f64>,
    /// Everything fixed to the body.
    pub(crate) inertia: RigidInertia,
}

/// A serial chain of 1 to [`MAX_JOINTS`] movable joints from a base link, fixed in the world, to a tip link.
///
/// Built by [`Chain::from_urdf`]; no function of it uses the heap after that.
#[derive(Clone, Debug, PartialEq)]
pub struct Chain {
    pub(crate) base_link: String,
    pub(crate) tip_link: String,
    pub(crate) joints: ArrayVec<Joint, MAX_JOINTS>,
    pub(crate) bodies: ArrayVec<Body, MAX_JOINTS>,
    pub(crate) collisions: Vec<Collision>,
    pub(crate) base_position: Vector3<f64>,
    pub(crate) base_rotation: Matrix3<f64>,
    /// Tip frame in the frame of the last body.
    pub(crate) tip_position: Vector3<f64>,
    pub(crate) tip_rotation: Matrix3<f64>,
}

impl Chain {
    /// The same chain with its base link at this pose in the world: position in m; roll, pitch, yaw in rad about the
    /// fixed x, y, z axes, in this order, as in URDF. All finite. A chain from URDF stands at the origin.
    #[must_use]
    pub fn with_base(mut self, position: [f64; 3], rpy_rad: [f64; 3]) -> Self {
        let [roll, pitch, yaw] = rpy_rad;
        self.base_position = Vector3::from(position);
        self.base_rotation = Rotation3::from_euler_angles(roll, pitch, yaw).into_inner();
        self
    }

    /// Movable joints, 1 to [`MAX_JOINTS`].
    #[inline]
    #[must_use]
    pub fn dof(&self) -> usize {
        self.bodies.len()
    }

    /// The movable joints from base to tip.
    #[must_use]
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// Collision shapes of all links of the chain and of what is fixed to them: the base's first, then body by body.
    #[must_use]
    pub fn collisions(&self) -> &[Collision] {
        &self.collisions
    }

    /// Name of the base link.
    #[must_use]
    pub fn base_link(&self) -> &str {
        &self.base_link
    }

    /// Name of the tip link.
    #[must_use]
    pub fn tip_link(&self) -> &str {
        &self.tip_link
    }

    /// Pose of the base link in the world, m.
    #[must_use]
    pub fn base_pose(&self) -> Isometry3<f64> {
        isometry(&self.base_rotation, &self.base_position)
    }

    /// Pose of the tip link in the frame of the last body, m.
    #[must_use]
    pub fn tip_offset(&self) -> Isometry3<f64> {
        isometry(&self.tip_rotation, &self.tip_position)
    }

    /// Mass, centre and inertia of a body with all that is fixed to it, in the frame of the link that joint `body` moves.
    ///
    /// Panics if `body` is not below [`Chain::dof`].
    #[must_use]
    pub fn inertia(&self, body: usize) -> &RigidInertia {
        &self.bodies[body].inertia
    }

    /// Pose of a collision shape of this chain in the world, m.
    #[must_use]
    pub fn collision_pose(&self, kin: &Kinematics, collision: &Collision) -> Isometry3<f64> {
        let body = match collision.body {
            Some(body) => kin.body_pose(body),
            None => self.base_pose(),
        };
        body * collision.origin
    }
}

/// Rotation matrix and position as a pose.
pub(crate) fn isometry(rotation: &Matrix3<f64>, position: &Vector3<f64>) -> Isometry3<f64> {
    let rotation = Rotation3::from_matrix_unchecked(*rotation);
    Isometry3::from_parts(Translation3::from(*position), UnitQuaternion::from_rotation_matrix(&rotation))
}
