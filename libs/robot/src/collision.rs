//! Collision shapes of a chain, as plain data.

use nalgebra::{Isometry3, Point3};
use std::sync::Arc;

/// A collision shape of a link, and its pose on its body.
#[derive(Clone, Debug, PartialEq)]
pub struct Collision {
    /// Name of the URDF link that declares it. Fixed links are lumped, so a joint need not move this very link.
    pub link: String,
    /// Body of the shape: 0-based index of the joint that moves it; `None` for the base.
    pub body: Option<usize>,
    /// Pose of the shape in the frame of that body [m]. [`crate::Chain::collision_pose`] returns the pose in the world.
    pub origin: Isometry3<f64>,
    /// The shape.
    pub shape: Shape,
}

/// A shape centred on its own frame. All lengths [m] are finite and above zero.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A sphere.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// A cylinder along z.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Whole length.
        length: f64,
    },
    /// A box.
    Box {
        /// Whole edge lengths along x, y, z.
        size: [f64; 3],
    },
    /// A cylinder along z with a half-sphere on each end.
    Capsule {
        /// Radius.
        radius: f64,
        /// Length of the cylinder alone, without the half-spheres.
        length: f64,
    },
    /// Convex hull of a mesh; the frame is in the middle of its bounding box.
    Hull {
        /// Corners of the hull [m].
        corners: Arc<[[f64; 3]]>,
    },
}

impl Collision {
    /// Spheres that reach as far as the shape at `pose` (of the shape, world frame): centres and radii [m]. Corners have radius zero.
    ///
    /// A cylinder is its largest capsule, as in the contacts.
    #[must_use]
    pub fn spheres(&self, pose: &Isometry3<f64>) -> Vec<(Point3<f64>, f64)> {
        let ends = |radius: f64, half: f64| vec![([0.0, 0.0, -half], radius), ([0.0, 0.0, half], radius)];
        let local = match &self.shape {
            Shape::Sphere { radius } => vec![([0.0; 3], *radius)],
            Shape::Cylinder { radius, length } => {
                let radius = radius.min(0.5 * length);
                ends(radius, 0.5 * length - radius)
            }
            Shape::Capsule { radius, length } => ends(*radius, 0.5 * length),
            Shape::Box { size } => (0..8)
                .map(|corner| (core::array::from_fn(|i| if corner >> i & 1 == 0 { 0.5 * size[i] } else { -0.5 * size[i] }), 0.0))
                .collect(),
            Shape::Hull { corners } => corners.iter().map(|corner| (*corner, 0.0)).collect(),
        };
        local.into_iter().map(|(center, radius)| (pose * Point3::from(center), radius)).collect()
    }
}

impl Shape {
    /// The shape in words, for messages.
    #[must_use]
    pub fn describe(&self) -> String {
        match self {
            Self::Sphere { radius } => format!("a sphere of {radius} m"),
            Self::Cylinder { radius, length } => format!("a cylinder of {radius} m and length {length} m"),
            Self::Capsule { radius, length } => format!("a capsule of {radius} m and length {length} m"),
            Self::Box { size: [x, y, z] } => format!("a box of {x} x {y} x {z} m"),
            Self::Hull { corners } => format!("a mesh whose hull has {} corners", corners.len()),
        }
    }
}
