//! The model: joints, bodies, collision shapes and the pose of the base.

use crate::collision::Collision;
use crate::inertia::RigidInertia;
use crate::kinematics::Kinematics;
use arrayvec::ArrayVec;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Maximum number of movable joints of a chain.
pub const MAX_JOINTS: usize = 16;

/// One number per joint; the first [`Chain::dof`] are valid.
pub type JointVector = [f64; MAX_JOINTS];

/// Kind of a movable joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Turns between limits.
    Revolute,
    /// Turns without limits.
    Continuous,
    /// Slides between limits.
    Prismatic,
}

/// Description of a movable joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name in the URDF.
    pub name: String,
    /// Name of the link it moves.
    pub child_link: String,
    /// Kind.
    pub kind: JointKind,
    /// Lower limit [rad or m]; finite, or minus infinity for a continuous joint.
    pub lower: f64,
    /// Upper limit [rad or m]; finite and not below `lower`, or infinity for a continuous joint.
    pub upper: f64,
    /// Peak torque [N m] or force [N]; finite, above zero.
    pub effort: f64,
    /// Speed limit [rad/s or m/s]; zero or more, infinite where URDF 1.2 omits it.
    pub velocity_limit: f64,
    /// Viscous damping [N m s/rad or N s/m]; finite, zero or more.
    pub damping: f64,
    /// Coulomb friction [N m or N]; finite, zero or more.
    pub friction: f64,
    /// Inertia of the rotor, seen at the joint [kg m^2 or kg]; finite, zero or more. Part of the mass matrix.
    pub armature: f64,
}

/// Constants of a movable joint and of the body behind it, up to the next movable joint.
///
/// The body's frame is that of the joint's child link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ChainBody {
    /// Whether the joint rotates (revolute, continuous); a prismatic joint slides.
    pub(crate) rotational: bool,
    /// Position of the joint in the frame of the previous body [m].
    pub(crate) joint_position: Vector3<f64>,
    /// Orientation R of the joint in the frame of the previous body.
    pub(crate) joint_rotation: Matrix3<f64>,
    /// R K, K the cross-product matrix of the axis: R (1 + sin K + (1 - cos) K^2) is the rotated frame (Rodrigues).
    pub(crate) joint_rotation_sin: Matrix3<f64>,
    /// R K^2.
    pub(crate) joint_rotation_versin: Matrix3<f64>,
    /// Axis (unit vector) in the frame of the previous body.
    pub(crate) axis: Vector3<f64>,
    /// Inertia of the body with everything fixed to it.
    pub(crate) inertia: RigidInertia,
}

/// A serial chain of 1 to [`MAX_JOINTS`] movable joints from a base link, fixed in the world, to a tip link.
///
/// [`Chain::from_urdf`] builds it; its other functions do not allocate.
#[derive(Clone, Debug, PartialEq)]
pub struct Chain {
    pub(crate) base_link: String,
    pub(crate) tip_link: String,
    pub(crate) joints: ArrayVec<Joint, MAX_JOINTS>,
    pub(crate) bodies: ArrayVec<ChainBody, MAX_JOINTS>,
    pub(crate) collisions: Vec<Collision>,
    pub(crate) warnings: Vec<String>,
    pub(crate) base_position: Vector3<f64>,
    pub(crate) base_rotation: Matrix3<f64>,
    /// Tip frame in the frame of the last body.
    pub(crate) tip_position: Vector3<f64>,
    pub(crate) tip_rotation: Matrix3<f64>,
}

impl Chain {
    /// Places the base link in the world: position [m]; roll, pitch, yaw [rad] as in URDF, all finite.
    ///
    /// The angles are about the fixed x, y, z axes, in this order. A chain from URDF is at the origin.
    #[must_use]
    pub fn with_base(mut self, position: [f64; 3], rpy_rad: [f64; 3]) -> Self {
        let [roll, pitch, yaw] = rpy_rad;
        self.base_position = Vector3::from(position);
        self.base_rotation = Rotation3::from_euler_angles(roll, pitch, yaw).into_inner();
        self
    }

    /// Number of movable joints, 1 to [`MAX_JOINTS`].
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

    /// Collision shapes of all links of the chain with everything fixed to them: the base first, then body by body.
    #[must_use]
    pub fn collisions(&self) -> &[Collision] {
        &self.collisions
    }

    /// What is odd in the description but usable, each with file, line and link or joint.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        &self.warnings
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

    /// Pose of the base link in the world [m].
    #[must_use]
    pub fn base_pose(&self) -> Isometry3<f64> {
        isometry(&self.base_rotation, &self.base_position)
    }

    /// Pose of the tip link in the frame of the last body [m].
    #[must_use]
    pub fn tip_offset(&self) -> Isometry3<f64> {
        isometry(&self.tip_rotation, &self.tip_position)
    }

    /// Mass, centre and inertia of a body with everything fixed to it, in the frame of the link that joint `body`
    /// moves.
    ///
    /// Panics if `body` is not below [`Chain::dof`].
    #[must_use]
    pub fn inertia(&self, body: usize) -> &RigidInertia {
        &self.bodies[body].inertia
    }

    /// Pose of a collision shape of this chain in the world [m].
    #[must_use]
    pub fn collision_pose(&self, kin: &Kinematics, collision: &Collision) -> Isometry3<f64> {
        let body = match collision.body {
            Some(body) => kin.body_pose(body),
            None => self.base_pose(),
        };
        body * collision.origin
    }
}

/// Pose of a rotation matrix and a position.
pub(crate) fn isometry(rotation: &Matrix3<f64>, position: &Vector3<f64>) -> Isometry3<f64> {
    let rotation = Rotation3::from_matrix_unchecked(*rotation);
    Isometry3::from_parts(Translation3::from(*position), UnitQuaternion::from_rotation_matrix(&rotation))
}
