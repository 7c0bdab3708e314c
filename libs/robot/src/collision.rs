//! Collision shapes of a chain, as plain data.

use nalgebra::Isometry3;

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
#[derive(Clone, Copy, Debug, PartialEq)]
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
}
