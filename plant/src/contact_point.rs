//! Contact points of two shapes. parry computes the distances that are not plain geometry.
//!
//! Contact points against the floor are the corners of a box and the ends of a capsule. Two boxes have the corners of
//! their manifold. Every other pair, also that of a hull, has its nearest point. Each point has the whole k and b of the law. Distances of a
//! capsule are those of its axis, a segment, less the radius, and thus exact.

use arrayvec::ArrayVec;
use nalgebra::{Isometry3, Matrix3, Vector3};
use parry3d_f64::math::{Pose, Rotation, Vector};
use parry3d_f64::query::epa::EPA;
use parry3d_f64::query::gjk::{self, CsoPoint, GJKResult, VoronoiSimplex};
use parry3d_f64::query::{self, Contact, ContactManifold, DefaultQueryDispatcher, PersistentQueryDispatcher};
use parry3d_f64::shape::{Ball, ConvexPolyhedron, Cuboid, HalfSpace, Segment, Shape, SupportMap};

/// Maximum number of contact points of a pair.
pub(crate) const MAX_CONTACT_POINTS: usize = 8;

/// A shape of a body.
#[derive(Clone, Copy, Debug)]
pub(crate) enum ContactShape {
    /// Everything below the plane z = 0.
    HalfSpace(HalfSpace),
    /// A ball.
    Ball(Ball),
    /// Everything within `radius` [m] of the segment of the z axis between two coordinates [m].
    Capsule { axis: [f64; 2], radius: f64 },
    /// A box.
    Box(Cuboid),
    /// A convex hull: its index among those of the scene, and the radius of its bounding sphere [m].
    Hull { index: usize, radius: f64 },
}

impl ContactShape {
    /// A capsule along z with its axis from `from` to `to` [m].
    pub(crate) fn capsule(from: f64, to: f64, radius: f64) -> Self {
        Self::Capsule { axis: [from, to], radius }
    }

    /// Radius of the bounding sphere about the shape's origin [m]; `None` for the half-space.
    pub(crate) fn bounding_radius(&self) -> Option<f64> {
        match self {
            Self::HalfSpace(_) => None,
            Self::Ball(ball) => Some(ball.radius),
            Self::Capsule { axis, radius } => Some(axis[0].abs().max(axis[1].abs()) + radius),
            Self::Box(cuboid) => Some(cuboid.half_extents.length()),
            Self::Hull { radius, .. } => Some(*radius),
        }
    }
}

/// A shape at its pose in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) enum PosedShape<'a> {
    HalfSpace { shape: &'a HalfSpace, pose: Pose, point: Vector3<f64>, normal: Vector3<f64> },
    Ball { ball: &'a Ball, center: Vector3<f64> },
    Capsule { axis: Segment, radius: f64 },
    Box { cuboid: &'a Cuboid, pose: Pose, center: Vector3<f64>, rotation: Matrix3<f64> },
    Hull { hull: &'a ConvexPolyhedron, pose: Pose },
}

impl PosedShape<'_> {
    /// The shape for parry's query, its pose, and the distance from it to the surface [m].
    fn core(&self) -> (&dyn Shape, Pose, f64) {
        match self {
            Self::HalfSpace { shape, pose, .. } => (*shape, *pose, 0.0),
            Self::Ball { ball, center } => (*ball, Pose::from_translation(vector(center)), 0.0),
            Self::Capsule { axis, radius } => (axis, Pose::identity(), *radius),
            Self::Box { cuboid, pose, .. } => (*cuboid, *pose, 0.0),
            Self::Hull { hull, pose } => (*hull, *pose, 0.0),
        }
    }
}

/// A point at which two shapes touch, or nearly do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ContactPoint {
    /// World point midway between the two surfaces [m].
    pub(crate) point: Vector3<f64>,
    /// Unit normal, from the second shape to the first.
    pub(crate) normal: Vector3<f64>,
    /// Penetration depth [m]; minus the gap where it is negative.
    pub(crate) depth: f64,
}

/// Contact points of a pair.
pub(crate) type ContactPoints = ArrayVec<ContactPoint, MAX_CONTACT_POINTS>;

pub(crate) fn vector(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

fn back(v: Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

/// Converts a pose to parry's type.
pub(crate) fn pose(p: &Isometry3<f64>) -> Pose {
    let q = p.rotation;
    Pose::from_parts(vector(&p.translation.vector), Rotation::from_xyzw(q.i, q.j, q.k, q.w))
}

/// Computes contact points; keeps parry's buffers, so that a query allocates nothing.
#[derive(Clone, Default)]
pub(crate) struct ContactFinder {
    manifolds: Vec<ContactManifold<(), ()>>,
    penetration: Penetration,
}

/// Buffers of the expanding polytope. A clone has its own, still empty.
#[derive(Default)]
struct Penetration(EPA);

impl Clone for Penetration {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl ContactFinder {
    /// Lets the buffers grow to what a hull needs, by penetrations of a box from several sides.
    pub(crate) fn warm_up(&mut self, hull: &ConvexPolyhedron, radius: f64) {
        let cuboid = Cuboid::new(Vector::splat(radius));
        for side in [Vector::ZERO, Vector::X, Vector::Y, Vector::Z, Vector::new(0.3, 0.5, 0.7), Vector::new(-0.7, 0.2, -0.4)] {
            let pos12 = Pose::from_translation(side * (0.5 * radius));
            let _ = convex_contact(&mut self.penetration, &pos12, hull, &cuboid, 0.0);
        }
    }

    /// Contact point midway between the nearest points of two shapes.
    fn nearest(&mut self, body: &PosedShape, against: &PosedShape, reach: f64, out: &mut ContactPoints) {
        let ((one, at_one, out_one), (two, at_two, out_two)) = (against.core(), body.core());
        let rounding = out_one + out_two;
        let round = one.as_ball().is_some() || two.as_ball().is_some();
        let contact = match (one.as_support_map(), two.as_support_map()) {
            (Some(a), Some(b)) if !round => {
                convex_contact(&mut self.penetration, &at_one.inv_mul(&at_two), a, b, reach + rounding).map(|mut contact| {
                    contact.transform_by_mut(&at_one, &at_two);
                    contact
                })
            }
            // A half-space comes first: parry 0.31.1 returns a wrong depth in the other order.
            _ => query::contact(&at_one, one, &at_two, two, reach + rounding).ok().flatten(),
        };
        let Some(contact) = contact else { return };
        let (a, b) = (contact.point1 + contact.normal1 * out_one, contact.point2 - contact.normal1 * out_two);
        out.push(ContactPoint { point: back(0.5 * (a + b)), normal: back(contact.normal1), depth: rounding - contact.dist });
    }

    /// Contact points of `body` and `against` with a gap below `reach` [m].
    pub(crate) fn find_contacts(&mut self, body: &PosedShape, against: &PosedShape, reach: f64, out: &mut ContactPoints) {
        out.clear();
        match (body, against) {
            (PosedShape::Ball { ball, center }, PosedShape::HalfSpace { point, normal, .. }) => {
                on_plane(center, ball.radius, (point, normal), reach, out);
            }
            (PosedShape::Capsule { axis, radius }, PosedShape::HalfSpace { point, normal, .. }) => {
                for end in [axis.a, axis.b] {
                    on_plane(&back(end), *radius, (point, normal), reach, out);
                }
            }
            (PosedShape::Box { cuboid, center, rotation, .. }, PosedShape::HalfSpace { point, normal, .. }) => {
                let e = cuboid.half_extents;
                let edges = [rotation.column(0) * e.x, rotation.column(1) * e.y, rotation.column(2) * e.z];
                for corner in 0..8 {
                    let edge = |bit: usize| if corner >> bit & 1 == 0 { edges[bit] } else { -edges[bit] };
                    on_plane(&(center + edge(0) + edge(1) + edge(2)), 0.0, (point, normal), reach, out);
                }
            }
            (PosedShape::Box { cuboid: a, pose: at, .. }, PosedShape::Box { cuboid: b, pose: to, .. }) => {
                self.boxes((a, at), (b, to), reach, out);
            }
            (PosedShape::Ball { ball, center }, PosedShape::Ball { ball: other, center: from }) => {
                round((center, ball.radius), (from, other.radius), reach, out);
            }
            (PosedShape::Capsule { axis, radius }, PosedShape::Ball { ball, center }) => {
                round((&on_axis(axis, center), *radius), (center, ball.radius), reach, out);
            }
            _ => self.nearest(body, against, reach, out),
        }
    }

    fn boxes(&mut self, body: (&Cuboid, &Pose), against: (&Cuboid, &Pose), reach: f64, out: &mut ContactPoints) {
        // parry's cached points belong to the previous pose: clear them.
        self.manifolds.iter_mut().for_each(|m| m.points.clear());
        let relative = against.1.inv_mul(body.1);
        if DefaultQueryDispatcher.contact_manifolds(&relative, against.0, body.0, reach, &mut self.manifolds, &mut None).is_err()
        {
            return;
        }
        for manifold in &self.manifolds {
            let normal = against.1.rotation * manifold.local_n1;
            for point in manifold.points.iter().filter(|p| p.dist < reach).take(MAX_CONTACT_POINTS - out.len()) {
                let (a, b) = (against.1 * point.local_p1, body.1 * point.local_p2);
                out.push(ContactPoint { point: back(0.5 * (a + b)), normal: back(normal), depth: -point.dist });
            }
        }
    }
}

/// Contact point of a sphere and a half-space.
fn on_plane(center: &Vector3<f64>, radius: f64, plane: (&Vector3<f64>, &Vector3<f64>), reach: f64, out: &mut ContactPoints) {
    let gap = plane.1.dot(&(center - plane.0)) - radius;
    if gap < reach && !out.is_full() {
        out.push(ContactPoint { point: center - plane.1 * (radius + 0.5 * gap), normal: *plane.1, depth: -gap });
    }
}

/// Point of a segment nearest to another point.
fn on_axis(axis: &Segment, point: &Vector3<f64>) -> Vector3<f64> {
    let (from, along) = (back(axis.a), back(axis.b - axis.a));
    from + along * ((point - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0)
}

/// Contact point of two spheres.
fn round(body: (&Vector3<f64>, f64), against: (&Vector3<f64>, f64), reach: f64, out: &mut ContactPoints) {
    let between = body.0 - against.0;
    let distance = between.norm();
    let gap = distance - body.1 - against.1;
    if gap < reach {
        // Concentric spheres are pushed apart along z.
        let normal = if distance > 0.0 { between / distance } else { Vector3::z() };
        out.push(ContactPoint { point: against.0 + normal * (against.1 + 0.5 * gap), normal, depth: -gap });
    }
}

/// Contact of two convex shapes, in parry's way, but with kept buffers: its own makes them anew for each penetration.
fn convex_contact(
    buffers: &mut Penetration,
    pos12: &Pose,
    one: &dyn SupportMap,
    two: &dyn SupportMap,
    reach: f64,
) -> Option<Contact> {
    let mut simplex = VoronoiSimplex::new();
    let found = match contact_outside(pos12, one, two, reach, &mut simplex) {
        GJKResult::Intersection => buffers.0.closest_points(pos12, one, two, &simplex),
        GJKResult::ClosestPoints(point1, point2, normal1) => Some((point1, point2, normal1)),
        _ => None,
    };
    let (point1, on_two, normal1) = found?;
    let dist = (on_two - point1).dot(normal1);
    Some(Contact::new(point1, pos12.inverse_transform_point(on_two), normal1, pos12.rotation.inverse() * -normal1, dist))
}

fn contact_outside(
    pos12: &Pose,
    one: &dyn SupportMap,
    two: &dyn SupportMap,
    reach: f64,
    simplex: &mut VoronoiSimplex,
) -> GJKResult {
    let direction = pos12.translation.try_normalize().unwrap_or(Vector::X);
    simplex.reset(CsoPoint::from_shapes(pos12, one, two, direction));
    gjk::closest_points(pos12, one, two, reach, true, simplex)
}
