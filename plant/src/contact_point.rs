//! Where two shapes touch, made into contact points; what is not plain geometry is parry's answer.
//!
//! A box against the floor touches with each of its corners, a capsule with each of its ends, two boxes with the corners of
//! their manifold, each with the whole k and b of the law; everything else touches at its nearest point. Capsules are asked for by
//! their axis, a segment, whose distance is exact, less their radius.

use arrayvec::ArrayVec;
use nalgebra::{Isometry3, Matrix3, Vector3};
use parry3d_f64::math::{Pose, Rotation, Vector};
use parry3d_f64::query::{self, ContactManifold, DefaultQueryDispatcher, PersistentQueryDispatcher};
use parry3d_f64::shape::{Ball, Cuboid, HalfSpace, Segment, Shape};

/// Most points of a pair.
pub(crate) const MAX_TOUCHES: usize = 8;

/// A shape of a body.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ContactShape {
    /// All below the plane z = 0.
    HalfSpace(HalfSpace),
    /// A ball.
    Ball(Ball),
    /// All within `radius`, m, of the piece of the z axis between two places.
    Capsule { axis: [f64; 2], radius: f64 },
    /// A box.
    Box(Cuboid),
}

impl ContactShape {
    /// A capsule along z with its axis from `from` to `to`, m.
    pub(crate) fn capsule(from: f64, to: f64, radius: f64) -> Self {
        Self::Capsule { axis: [from, to], radius }
    }

    /// Radius of a sphere about the shape's origin that holds it, m; none for the half-space.
    pub(crate) fn reach(&self) -> Option<f64> {
        match self {
            Self::HalfSpace(_) => None,
            Self::Ball(ball) => Some(ball.radius),
            Self::Capsule { axis, radius } => Some(axis[0].abs().max(axis[1].abs()) + radius),
            Self::Box(cuboid) => Some(cuboid.half_extents.length()),
        }
    }
}

/// A shape where it is in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Solid<'a> {
    HalfSpace { shape: &'a HalfSpace, pose: Pose, point: Vector3<f64>, normal: Vector3<f64> },
    Ball { ball: &'a Ball, center: Vector3<f64> },
    Capsule { axis: Segment, radius: f64 },
    Box { cuboid: &'a Cuboid, pose: Pose, center: Vector3<f64>, rotation: Matrix3<f64> },
}

impl Solid<'_> {
    /// The shape whose distance is asked for, its pose, and how far the surface is out from it.
    fn core(&self) -> (&dyn Shape, Pose, f64) {
        match self {
            Self::HalfSpace { shape, pose, .. } => (*shape, *pose, 0.0),
            Self::Ball { ball, center } => (*ball, Pose::from_translation(vector(center)), 0.0),
            Self::Capsule { axis, radius } => (axis, Pose::identity(), *radius),
            Self::Box { cuboid, pose, .. } => (*cuboid, *pose, 0.0),
        }
    }
}

/// Where two shapes touch, or nearly do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ContactPoint {
    /// World point midway between the two surfaces, m.
    pub(crate) point: Vector3<f64>,
    /// Unit normal, from the second shape to the first.
    pub(crate) normal: Vector3<f64>,
    /// Penetration, m; negative: the gap.
    pub(crate) depth: f64,
}

/// The points of a pair.
pub(crate) type Touches = ArrayVec<ContactPoint, MAX_TOUCHES>;

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

/// Finds where shapes touch. Keeps parry's memory, so that asking costs no heap.
#[derive(Clone, Default)]
pub(crate) struct Finder {
    manifolds: Vec<ContactManifold<(), ()>>,
}

impl Finder {
    /// Where `body` touches `against`, as far as their gap is below `reach`, m.
    pub(crate) fn touches(&mut self, body: &Solid, against: &Solid, reach: f64, out: &mut Touches) {
        out.clear();
        match (body, against) {
            (Solid::Ball { ball, center }, Solid::HalfSpace { point, normal, .. }) => {
                on_plane(center, ball.radius, (point, normal), reach, out);
            }
            (Solid::Capsule { axis, radius }, Solid::HalfSpace { point, normal, .. }) => {
                for end in [axis.a, axis.b] {
                    on_plane(&back(end), *radius, (point, normal), reach, out);
                }
            }
            (Solid::Box { cuboid, center, rotation, .. }, Solid::HalfSpace { point, normal, .. }) => {
                let e = cuboid.half_extents;
                let edges = [rotation.column(0) * e.x, rotation.column(1) * e.y, rotation.column(2) * e.z];
                for corner in 0..8 {
                    let edge = |bit: usize| if corner >> bit & 1 == 0 { edges[bit] } else { -edges[bit] };
                    on_plane(&(center + edge(0) + edge(1) + edge(2)), 0.0, (point, normal), reach, out);
                }
            }
            (Solid::Box { cuboid: a, pose: at, .. }, Solid::Box { cuboid: b, pose: to, .. }) => {
                self.boxes((a, at), (b, to), reach, out);
            }
            (Solid::Ball { ball, center }, Solid::Ball { ball: other, center: from }) => {
                round((center, ball.radius), (from, other.radius), reach, out);
            }
            (Solid::Capsule { axis, radius }, Solid::Ball { ball, center }) => {
                round((&on_axis(axis, center), *radius), (center, ball.radius), reach, out);
            }
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
                out.push(ContactPoint { point: back(0.5 * (a + b)), normal: back(normal), depth: -point.dist });
            }
        }
    }
}

/// A point with a radius over a half-space.
fn on_plane(center: &Vector3<f64>, radius: f64, plane: (&Vector3<f64>, &Vector3<f64>), reach: f64, out: &mut Touches) {
    let gap = plane.1.dot(&(center - plane.0)) - radius;
    if gap < reach && !out.is_full() {
        out.push(ContactPoint { point: center - plane.1 * (radius + 0.5 * gap), normal: *plane.1, depth: -gap });
    }
}

/// Point of a segment that is nearest to another.
fn on_axis(axis: &Segment, point: &Vector3<f64>) -> Vector3<f64> {
    let (from, along) = (back(axis.a), back(axis.b - axis.a));
    from + along * ((point - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0)
}

/// Two points with their radii.
fn round(body: (&Vector3<f64>, f64), against: (&Vector3<f64>, f64), reach: f64, out: &mut Touches) {
    let between = body.0 - against.0;
    let distance = between.norm();
    let gap = distance - body.1 - against.1;
    if gap < reach {
        // One in the middle of the other is pushed up.
        let normal = if distance > 0.0 { between / distance } else { Vector3::z() };
        out.push(ContactPoint { point: against.0 + normal * (against.1 + 0.5 * gap), normal, depth: -gap });
    }
}

/// The nearest points of two shapes.
fn nearest(body: &Solid, against: &Solid, reach: f64, out: &mut Touches) {
    let ((one, at_one, out_one), (two, at_two, out_two)) = (against.core(), body.core());
    let rounding = out_one + out_two;
    // The half-space, if there is one, comes first: parry 0.31.1 returns a wrong depth the other way round.
    let Ok(Some(contact)) = query::contact(&at_one, one, &at_two, two, reach + rounding) else { return };
    let (a, b) = (contact.point1 + contact.normal1 * out_one, contact.point2 - contact.normal1 * out_two);
    out.push(ContactPoint { point: back(0.5 * (a + b)), normal: back(contact.normal1), depth: rounding - contact.dist });
}
