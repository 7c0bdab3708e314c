//! Poses and velocities of bodies and colliders at one instant.

use crate::contact_point::{ContactShape, PosedShape, pose, vector};
use crate::object::FreeBody;
use arrayvec::ArrayVec;
use hapfic_messages::MAX_OBJECTS;
use hapfic_robot::{Chain, JointKind, Kinematics, MAX_JOINTS};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use parry3d_f64::shape::ConvexPolyhedron;

/// Body that a collider is fixed to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum BodyId {
    /// The world.
    World,
    /// A moving body of the chain.
    Link(usize),
    /// A free body.
    Object(usize),
}

/// A shape fixed to a body.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Collider {
    pub(crate) parent: BodyId,
    pub(crate) shape: ContactShape,
    /// Index among the names of the scene.
    pub(crate) name_index: usize,
    /// Index among the colliders of the scene.
    pub(crate) index: usize,
    /// Pose in the frame of the body.
    local: Isometry3<f64>,
    local_rotation: Matrix3<f64>,
    /// Radius of the bounding sphere about the origin [m]; zero for the half-space, which does not move.
    bounding_radius: f64,
}

impl Collider {
    pub(crate) fn new(parent: BodyId, shape: ContactShape, local: Isometry3<f64>, name_index: usize, index: usize) -> Self {
        let local_rotation = local.rotation.to_rotation_matrix().into_inner();
        Self { parent, shape, name_index, index, local, local_rotation, bounding_radius: shape.bounding_radius().unwrap_or(0.0) }
    }

    /// Pose in the frame of the body.
    pub(crate) fn local(&self) -> Isometry3<f64> {
        self.local
    }

    /// The same collider with another shape and index.
    pub(crate) fn with(&self, shape: ContactShape, index: usize) -> Self {
        Self::new(self.parent, shape, self.local, self.name_index, index)
    }
}

/// Pose and velocity of a body's frame.
#[derive(Clone, Copy, Debug)]
struct BodyMotion {
    origin: Vector3<f64>,
    rotation: Matrix3<f64>,
    velocity: Vector3<f64>,
    angular: Vector3<f64>,
}

impl BodyMotion {
    /// At rest.
    const WORLD: Self = Self {
        origin: Vector3::new(0.0, 0.0, 0.0),
        rotation: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        velocity: Vector3::new(0.0, 0.0, 0.0),
        angular: Vector3::new(0.0, 0.0, 0.0),
    };

    fn of(body: &FreeBody) -> Self {
        let rotation = body.rotation.to_rotation_matrix().into_inner();
        Self { origin: body.position, rotation, velocity: body.velocity, angular: body.angular_velocity }
    }
}

/// Pose and speed of a collider.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ColliderState {
    /// Origin [m].
    pub(crate) center: Vector3<f64>,
    /// Orientation.
    pub(crate) rotation: Matrix3<f64>,
    /// Upper bound of the speed of the surface [m/s].
    pub(crate) speed: f64,
}

impl ColliderState {
    fn new(collider: &Collider, frame: &BodyMotion) -> Self {
        let arm = frame.rotation * collider.local.translation.vector;
        let speed = (frame.velocity + frame.angular.cross(&arm)).norm() + frame.angular.norm() * collider.bounding_radius;
        Self { center: frame.origin + arm, rotation: frame.rotation * collider.local_rotation, speed }
    }

    /// Upper bound of the distance that any point of the surface has moved since `from` [m].
    pub(crate) fn travel(&self, collider: &Collider, from: &(Vector3<f64>, Matrix3<f64>)) -> f64 {
        let shift = (self.center - from.0).norm();
        match collider.shape {
            ContactShape::Ball(_) | ContactShape::HalfSpace(_) => shift,
            // The Frobenius norm bounds the spectral one.
            ContactShape::Capsule { .. } | ContactShape::Box(_) | ContactShape::Hull { .. } => {
                shift + (self.rotation - from.1).norm() * collider.bounding_radius
            }
        }
    }

    /// The shape at its pose, as input of the distance queries.
    pub(crate) fn posed_shape<'a>(
        &self,
        collider: &'a Collider,
        hulls: &'a [ConvexPolyhedron],
        objects: &[FreeBody],
    ) -> PosedShape<'a> {
        match &collider.shape {
            ContactShape::HalfSpace(shape) => PosedShape::HalfSpace {
                shape,
                pose: pose(&Isometry3::from_parts(Translation3::from(self.center), collider.local.rotation)),
                point: self.center,
                normal: self.rotation.column(2).into_owned(),
            },
            ContactShape::Ball(ball) => PosedShape::Ball { ball, center: self.center },
            ContactShape::Capsule { axis, radius } => {
                let end = |z: f64| vector(&(self.center + self.rotation.column(2) * z));
                PosedShape::Capsule { axis: parry3d_f64::shape::Segment::new(end(axis[0]), end(axis[1])), radius: *radius }
            }
            ContactShape::Hull { index, .. } => {
                let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(self.rotation));
                let pose = pose(&Isometry3::from_parts(Translation3::from(self.center), rotation));
                PosedShape::Hull { hull: &hulls[*index], pose }
            }
            ContactShape::Box(cuboid) => {
                let rotation = match collider.parent {
                    // The body's own quaternion, bit for bit.
                    BodyId::Object(i) => objects[i].rotation * collider.local.rotation,
                    _ => UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(self.rotation)),
                };
                let pose = pose(&Isometry3::from_parts(Translation3::from(self.center), rotation));
                PosedShape::Box { cuboid, pose, center: self.center, rotation: self.rotation }
            }
        }
    }
}

/// States of all colliders of a scene at one instant.
#[derive(Clone, Debug)]
pub(crate) struct ColliderStates {
    /// Number of updates so far.
    pub(crate) instant: u64,
    states: Vec<ColliderState>,
}

impl ColliderStates {
    /// Creates the states of `shapes` colliders, all at the origin.
    pub(crate) fn new(shapes: usize) -> Self {
        let at_origin = ColliderState { center: Vector3::zeros(), rotation: Matrix3::identity(), speed: 0.0 };
        Self { instant: 0, states: vec![at_origin; shapes] }
    }

    /// State of a collider.
    #[inline]
    pub(crate) fn of(&self, collider: &Collider) -> &ColliderState {
        &self.states[collider.index]
    }

    /// Recomputes all states.
    pub(crate) fn update(&mut self, colliders: &[Collider], chain: &Chain, kin: &Kinematics, qd: &[f64], objects: &[FreeBody]) {
        self.instant += 1;
        let links = links(chain, kin, qd);
        let objects: ArrayVec<BodyMotion, MAX_OBJECTS> = objects.iter().map(BodyMotion::of).collect();
        for collider in colliders {
            let frame = match collider.parent {
                BodyId::World => &BodyMotion::WORLD,
                BodyId::Link(i) => &links[i],
                BodyId::Object(i) => &objects[i],
            };
            self.states[collider.index] = ColliderState::new(collider, frame);
        }
    }
}

/// Poses and velocities of the moving bodies of the chain.
fn links(chain: &Chain, kin: &Kinematics, qd: &[f64]) -> ArrayVec<BodyMotion, MAX_JOINTS> {
    let (mut velocity, mut angular): (Vector3<f64>, Vector3<f64>) = (Vector3::zeros(), Vector3::zeros());
    let mut before = Vector3::zeros();
    let mut frames = ArrayVec::new();
    for (i, (joint, rate)) in chain.joints().iter().zip(qd).enumerate() {
        let (origin, axis) = (kin.body_origin(i), kin.joint_axis(i));
        velocity += angular.cross(&(origin - before));
        match joint.kind {
            JointKind::Revolute | JointKind::Continuous => angular += axis * *rate,
            JointKind::Prismatic => velocity += axis * *rate,
        }
        before = origin;
        frames.push(BodyMotion { origin, rotation: kin.body_rotation(i), velocity, angular });
    }
    frames
}
