//! Where bodies and shapes are, and how they move, at one instant.

use crate::contact_point::{ContactShape, Solid, pose, vector};
use crate::object::FreeBody;
use arrayvec::ArrayVec;
use hapfic_messages::MAX_OBJECTS;
use hapfic_robot::{Chain, JointKind, Kinematics, MAX_JOINTS};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// What a shape is fixed to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Body {
    /// The world.
    World,
    /// A moving body of the chain.
    Link(usize),
    /// A free body.
    Object(usize),
}

/// A shape with its carrier and its name's place among the names of a scene.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Collider {
    pub(crate) carrier: Body,
    pub(crate) form: ContactShape,
    pub(crate) name: usize,
    /// Its place among the placed shapes of a scene.
    pub(crate) place: usize,
    /// In the frame of the carrier.
    local: Isometry3<f64>,
    turn: Matrix3<f64>,
    /// Radius of a sphere about its origin that holds it, m; nothing for the half-space, which does not move.
    reach: f64,
}

impl Collider {
    pub(crate) fn new(carrier: Body, form: ContactShape, local: Isometry3<f64>, name: usize, place: usize) -> Self {
        let turn = local.rotation.to_rotation_matrix().into_inner();
        Self { carrier, form, name, place, local, turn, reach: form.reach().unwrap_or(0.0) }
    }

    /// The same with another shape.
    pub(crate) fn with(&self, form: ContactShape, place: usize) -> Self {
        Self::new(self.carrier, form, self.local, self.name, place)
    }
}

/// A frame in motion.
#[derive(Clone, Copy, Debug)]
struct Frame {
    origin: Vector3<f64>,
    rotation: Matrix3<f64>,
    velocity: Vector3<f64>,
    angular: Vector3<f64>,
}

impl Frame {
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

/// A shape in motion.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed {
    /// Its origin, m.
    pub(crate) center: Vector3<f64>,
    /// Its orientation.
    pub(crate) rotation: Matrix3<f64>,
    /// An upper bound of the speed of its surface, m/s.
    pub(crate) speed: f64,
}

impl Placed {
    fn new(side: &Collider, frame: &Frame) -> Self {
        let arm = frame.rotation * side.local.translation.vector;
        let speed = (frame.velocity + frame.angular.cross(&arm)).norm() + frame.angular.norm() * side.reach;
        Self { center: frame.origin + arm, rotation: frame.rotation * side.turn, speed }
    }

    /// An upper bound of the way from there to here of any point of its surface, m.
    pub(crate) fn way(&self, side: &Collider, from: &(Vector3<f64>, Matrix3<f64>)) -> f64 {
        let shift = (self.center - from.0).norm();
        match side.form {
            ContactShape::Ball(_) | ContactShape::HalfSpace(_) => shift,
            // The Frobenius norm bounds the spectral one.
            ContactShape::Capsule { .. } | ContactShape::Box(_) => shift + (self.rotation - from.1).norm() * side.reach,
        }
    }

    /// The shape as the queries take it.
    pub(crate) fn solid<'a>(&self, side: &'a Collider, objects: &[FreeBody]) -> Solid<'a> {
        match &side.form {
            ContactShape::HalfSpace(shape) => Solid::HalfSpace {
                shape,
                pose: pose(&Isometry3::from_parts(Translation3::from(self.center), side.local.rotation)),
                point: self.center,
                normal: self.rotation.column(2).into_owned(),
            },
            ContactShape::Ball(ball) => Solid::Ball { ball, center: self.center },
            ContactShape::Capsule { axis, radius } => {
                let end = |z: f64| vector(&(self.center + self.rotation.column(2) * z));
                Solid::Capsule { axis: parry3d_f64::shape::Segment::new(end(axis[0]), end(axis[1])), radius: *radius }
            }
            ContactShape::Box(cuboid) => {
                let rotation = match side.carrier {
                    // As it is, to the last bit.
                    Body::Object(i) => objects[i].rotation * side.local.rotation,
                    _ => UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(self.rotation)),
                };
                let pose = pose(&Isometry3::from_parts(Translation3::from(self.center), rotation));
                Solid::Box { cuboid, pose, center: self.center, rotation: self.rotation }
            }
        }
    }
}

/// The shapes of a scene at one instant.
#[derive(Clone, Debug)]
pub(crate) struct Places {
    /// Counts the instants.
    pub(crate) instant: u64,
    places: Vec<Placed>,
}

impl Places {
    /// Room for so many shapes.
    pub(crate) fn new(shapes: usize) -> Self {
        let nowhere = Placed { center: Vector3::zeros(), rotation: Matrix3::identity(), speed: 0.0 };
        Self { instant: 0, places: vec![nowhere; shapes] }
    }

    /// Where a shape is.
    #[inline]
    pub(crate) fn of(&self, side: &Collider) -> &Placed {
        &self.places[side.place]
    }

    /// Finds where all of them are.
    pub(crate) fn update(&mut self, sides: &[Collider], chain: &Chain, kin: &Kinematics, qd: &[f64], objects: &[FreeBody]) {
        self.instant += 1;
        let links = links(chain, kin, qd);
        let objects: ArrayVec<Frame, MAX_OBJECTS> = objects.iter().map(Frame::of).collect();
        for side in sides {
            let frame = match side.carrier {
                Body::World => &Frame::WORLD,
                Body::Link(i) => &links[i],
                Body::Object(i) => &objects[i],
            };
            self.places[side.place] = Placed::new(side, frame);
        }
    }
}

/// The moving bodies of the chain.
fn links(chain: &Chain, kin: &Kinematics, qd: &[f64]) -> ArrayVec<Frame, MAX_JOINTS> {
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
        frames.push(Frame { origin, rotation: kin.body_rotation(i), velocity, angular });
    }
    frames
}
