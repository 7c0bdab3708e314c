//! Parts of links and joints: origins, inertia and collision shapes, with every number checked.

use crate::collision::{Collision, Shape};
use crate::error::RobotError;
use crate::inertia::RigidInertia;
use crate::mesh;
use crate::urdf::Link;
use crate::xml::Element;
use nalgebra::{Isometry3, IsometryMatrix3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Tolerance of the checks of inertia, relative to the sum of the principal moments: rounding in the file.
const INERTIA_TOLERANCE: f64 = 1e-6;

/// The checked `<origin>` in an element; the identity if there is none.
pub(crate) fn pose(element: Element<'_>, place: impl Fn() -> String) -> Result<IsometryMatrix3<f64>, RobotError> {
    let Some(origin) = element.child("origin") else { return Ok(IsometryMatrix3::identity()) };
    let read = |attribute: &'static str| {
        let place = || format!("{} {attribute}", place());
        let values = origin.triple(attribute, place)?.unwrap_or([0.0; 3]);
        values.iter().try_for_each(|value| origin.bounded(*value, place))?;
        Ok(values)
    };
    let (xyz, [roll, pitch, yaw]) = (read("xyz")?, read("rpy")?);
    let translation = Translation3::from(Vector3::from(xyz));
    Ok(IsometryMatrix3::from_parts(translation, Rotation3::from_euler_angles(roll, pitch, yaw)))
}

/// The inertia of one link, in its own frame; its numbers are finite.
pub(crate) fn inertia(link: &Link<'_>) -> Result<RigidInertia, RobotError> {
    let name = link.name;
    let Some(inertial) = link.element.child("inertial") else { return Ok(RigidInertia::zero()) };
    let pose = pose(inertial, || format!("link '{name}' <inertial><origin>"))?;
    let mass_place = || format!("link '{name}' <mass value>");
    let mass_kg = match inertial.child("mass") {
        Some(mass) => {
            let value = mass.number("value", mass_place)?.unwrap_or(0.0);
            mass.not_negative(value, mass_place)?;
            value
        }
        None => 0.0,
    };
    let mut moments = [0.0; 6];
    if let Some(inertia) = inertial.child("inertia") {
        for (moment, attribute) in moments.iter_mut().zip(["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]) {
            let place = || format!("link '{name}' <inertia {attribute}>");
            *moment = inertia.number(attribute, place)?.unwrap_or(0.0);
            inertia.bounded(*moment, place)?;
        }
    }
    let [xx, xy, xz, yy, yz, zz] = moments;
    let inertia_kg_m2 = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    Ok(RigidInertia { mass_kg, center_m: Vector3::zeros(), inertia_kg_m2 }.placed(&pose))
}

/// The condition that only sharp measurements violate: a mass matrix may be positive definite all the same.
pub(crate) const TRIANGLE: &str = "none of them above the sum of the other two";

/// Principal moments of an inertia that no body can have, ascending, and the violated condition.
pub(crate) fn impossible(inertia: &Matrix3<f64>) -> Option<([f64; 3], &'static str)> {
    if *inertia == Matrix3::zeros() {
        return None;
    }
    let Some(eigen) = inertia.try_symmetric_eigen(f64::EPSILON, 1000) else {
        return Some(([f64::NAN; 3], "numbers that have principal moments"));
    };
    let mut principal = [eigen.eigenvalues[0], eigen.eigenvalues[1], eigen.eigenvalues[2]];
    principal.sort_by(f64::total_cmp);
    let [small, middle, large] = principal;
    let tolerance = INERTIA_TOLERANCE * inertia.trace().abs().max(large.abs());
    if small < -tolerance {
        Some((principal, "none of them negative"))
    } else if large > small + middle + tolerance {
        Some((principal, TRIANGLE))
    } else {
        None
    }
}

/// A collision shape of a link that is at `on_body` on a body.
pub(crate) fn collision(
    link: &str,
    collision: Element<'_>,
    body: Option<usize>,
    on_body: &IsometryMatrix3<f64>,
    file: &str,
) -> Result<Collision, RobotError> {
    let own = pose(collision, || format!("link '{link}' <collision><origin>"))?;
    let missing = || collision.unreadable(format!("link '{link}' <collision> has no <geometry> with a shape"));
    let geometry = collision.child("geometry").and_then(Element::first).ok_or_else(missing)?;
    let placed = on_body * own;
    let (shape, placed) = if geometry.tag() == "mesh" {
        let (center, corners) = mesh::hull(link, geometry, file)?;
        (Shape::Hull { corners }, placed * Translation3::from(center))
    } else {
        (shape(link, geometry)?, placed)
    };
    let origin = Isometry3::from_parts(placed.translation, UnitQuaternion::from_rotation_matrix(&placed.rotation));
    Ok(Collision { link: link.to_owned(), body, origin, shape })
}

/// The checked shape of a geometry.
fn shape(link: &str, geometry: Element<'_>) -> Result<Shape, RobotError> {
    let length = |attribute: &'static str| {
        let place = || format!("link '{link}' <collision> {} {attribute}", geometry.tag());
        let value = geometry.number(attribute, place)?.unwrap_or(0.0);
        geometry.positive(value, place).map(|()| value)
    };
    match geometry.tag() {
        "sphere" => Ok(Shape::Sphere { radius: length("radius")? }),
        "cylinder" => Ok(Shape::Cylinder { radius: length("radius")?, length: length("length")? }),
        "capsule" => Ok(Shape::Capsule { radius: length("radius")?, length: length("length")? }),
        "box" => {
            let place = || format!("link '{link}' <collision> box size");
            let size = geometry.triple("size", place)?.unwrap_or([0.0; 3]);
            size.iter().try_for_each(|edge| geometry.positive(*edge, place))?;
            Ok(Shape::Box { size })
        }
        other => Err(geometry.unreadable(format!("link '{link}' <collision> has the unknown shape <{other}>"))),
    }
}
