//! Where two shapes touch: parry's answers, made into contact points.
//!
//! A box against the floor touches with each of its corners, a capsule with each of its ends, two boxes with the corners of
//! their manifold, each with the whole k and b of the law; everything else touches at its nearest point. Capsules are asked for by
//! their axis, a segment, whose distance is exact, less their radius.

use arrayvec::ArrayVec;
use nalgebra::{Isometry3, Vector3};
use parry3d_f64::math::{Pose, Rotation, Vector};
use parry3d_f64::query::{self, ContactManifold, DefaultQueryDispatcher, PersistentQueryDispatcher};
use parry3d_f64::shape::{Ball, Cuboid, HalfSpace, Segment, Shape};

/// Most points of a pair.
pub(crate) const MAX_TOUCHES: usize = 8;

/// A shape of a body.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Form {
    /// All below the plane z = 0.
    HalfSpace(HalfSpace),
    /// A ball.
    Ball(Ball),
    /// All within `radius`, m, of a segment.
    Capsule { axis: Segment, radius: f64 },
    /// A box.
    Box(Cuboid),
}

/// Where two shapes touch, or nearly do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Touch {
    /// World point midway between the two surfaces, m.
    pub(crate) point: Vector3<f64>,
    /// Unit normal, from the second shape to the first.
    pub(crate) normal: Vector3<f64>,
    /// Penetration, m; negative: the gap.
    pub(crate) depth: f64,
}

/// The points of a pair.
pub(crate) type Touches = ArrayVec<Touch, MAX_TOUCHES>;

pub(crate) fn vector(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

fn back(v: Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

/// parry's pose.
pub(crate) fn pose(p: &Isometry3<f64>) -> Pose {
    let q = p.rotation;
    Pose::from_parts(vector(&p.translation.vector), Rotation::from_xyzw(q.i, q.j, q.k, q.w))
}

impl Form {
    /// A capsule along z with its axis from `from` to `to`, m.
    pub(crate) fn capsule(from: f64, to: f64, radius: f64) -> Self {
        Self::Capsule { axis: Segment::new(Vector::new(0.0, 0.0, from), Vector::new(0.0, 0.0, to)), radius }
    }

    /// Radius of a sphere about the shape's origin that holds it, m; none for the half-space.
    pub(crate) fn reach(&self) -> Option<f64> {
        match self {
            Self::HalfSpace(_) => None,
            Self::Ball(ball) => Some(ball.radius),
            Self::Capsule { axis, radius } => Some(axis.a.length().max(axis.b.length()) + radius),
            Self::Box(cuboid) => Some(cuboid.half_extents.length()),
        }
    }

    /// The shape whose distance is asked for, and how far the surface is out from it.
    fn core(&self) -> (&dyn Shape, f64) {
        match self {
            Self::HalfSpace(shape) => (shape, 0.0),
            Self::Ball(shape) => (shape, 0.0),
            Self::Capsule { axis, radius } => (axis, *radius),
            Self::Box(shape) => (shape, 0.0),
        }
    }
}

/// Finds where shapes touch. Keeps parry's memory, so that asking costs no heap.
#[derive(Clone, Default)]
pub(crate) struct Finder {
    manifolds: Vec<ContactManifold<(), ()>>,
}

impl Finder {
    /// Where `body` touches `against`, both at their poses, as far as their gap is below `reach`, m.
    pub(crate) fn touches(&mut self, body: (&Form, &Pose), against: (&Form, &Pose), reach: f64, out: &mut Touches) {
        out.clear();
        if !near(body, against, reach) {
            return;
        }
        match (body.0, against.0) {
            (Form::Capsule { axis, radius }, Form::HalfSpace(_)) => {
                for end in [axis.a, axis.b] {
                    on_plane(body.1, end, *radius, against.1, reach, out);
                }
            }
            (Form::Box(cuboid), Form::HalfSpace(_)) => {
                let e = cuboid.half_extents;
                for corner in 0..8 {
                    let sign = |bit: u32| if corner >> bit & 1 == 0 { 1.0 } else { -1.0 };
                    let corner = Vector::new(sign(0) * e.x, sign(1) * e.y, sign(2) * e.z);
                    on_plane(body.1, corner, 0.0, against.1, reach, out);
                }
            }
            (Form::Box(a), Form::Box(b)) => self.boxes((a, body.1), (b, against.1), reach, out),
            _ => nearest(body, against, reach, out),
        }
    }

    fn boxes(&mut self, body: (&Cuboid, &Pose), against: (&Cuboid, &Pose), reach: f64, out: &mut Touches) {
        // What parry remembers of the pose before would be off by what has moved since: start afresh.
        self.manifolds.iter_mut().for_each(|m| m.points.clear());
        let relative = against.1.inv_mul(body.1);
        if DefaultQueryDispatcher.contact_manifolds(&relative, against.0, body.0, reach, &mut self.manifolds, &mut None).is_err()
        {
            return;
        }
        for manifold in &self.manifolds {
            let normal = against.1.rotation * manifold.local_n1;
            for point in manifold.points.iter().filter(|p| p.dist < reach).take(MAX_TOUCHES - out.len()) {
                let (a, b) = (against.1 * point.local_p1, body.1 * point.local_p2);
                out.push(Touch { point: back(0.5 * (a + b)), normal: back(normal), depth: -point.dist });
            }
        }
    }
}

/// Whether the spheres about two shapes are nearer than `reach`.
fn near(a: (&Form, &Pose), b: (&Form, &Pose), reach: f64) -> bool {
    match (a.0.reach(), b.0.reach()) {
        (Some(ra), Some(rb)) => {
            let limit = ra + rb + reach;
            (a.1.translation - b.1.translation).length_squared() <= limit * limit
        }
        (Some(ra), None) => height(a.1.translation, b.1) <= ra + reach,
        (None, Some(rb)) => height(b.1.translation, a.1) <= rb + reach,
        (None, None) => false,
    }
}

/// How high a point is over a half-space.
fn height(point: Vector, plane: &Pose) -> f64 {
    (plane.rotation * Vector::Z).dot(point - plane.translation)
}

/// One point of a body, with a radius, over a half-space.
fn on_plane(body: &Pose, local: Vector, radius: f64, plane: &Pose, reach: f64, out: &mut Touches) {
    let (center, normal) = (*body * local, plane.rotation * Vector::Z);
    let gap = height(center, plane) - radius;
    if gap < reach && !out.is_full() {
        let point = center - normal * (radius + 0.5 * gap);
        out.push(Touch { point: back(point), normal: back(normal), depth: -gap });
    }
}

/// The nearest points of two shapes.
fn nearest(body: (&Form, &Pose), against: (&Form, &Pose), reach: f64, out: &mut Touches) {
    let ((one, out_one), (two, out_two)) = (against.0.core(), body.0.core());
    let rounding = out_one + out_two;
    // The half-space, if there is one, comes first: parry 0.31.1 returns a wrong depth the other way round.
    let Ok(Some(contact)) = query::contact(against.1, one, body.1, two, reach + rounding) else { return };
    let (a, b) = (contact.point1 + contact.normal1 * out_one, contact.point2 - contact.normal1 * out_two);
    out.push(Touch { point: back(0.5 * (a + b)), normal: back(contact.normal1), depth: rounding - contact.dist });
}
