//! What a world begins with.

use hapfic_robot::{Chain, JointVector};
use nalgebra::{Isometry3, Vector3};

/// Softness of all contacts: of the spring and damper that a contact is between two bodies of their effective mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Softness {
    /// Natural frequency [Hz].
    pub frequency_hz: f64,
    /// Damping ratio.
    pub damping_ratio: f64,
}

/// Body that a collider is fixed to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parent {
    /// The world.
    World,
    /// A moving body of the chain.
    Link(usize),
    /// A free body.
    Object(usize),
}

/// Shape of a collider in its own frame.
#[derive(Clone, Debug, PartialEq)]
pub enum RapierShape {
    /// Everything below the plane z = 0.
    HalfSpace,
    /// A ball.
    Ball {
        /// Radius [m].
        radius: f64,
    },
    /// Everything within `radius` [m] of a segment of the z axis.
    Capsule {
        /// Ends of the segment [m].
        axis: [f64; 2],
        /// Radius [m].
        radius: f64,
    },
    /// A box.
    Box {
        /// Half the edges along x, y and z [m].
        half: [f64; 3],
    },
    /// The convex hull of points [m].
    Hull {
        /// Corners.
        corners: Vec<[f64; 3]>,
    },
}

/// A shape fixed to a body.
#[derive(Clone, Debug, PartialEq)]
pub struct RapierCollider {
    /// Body.
    pub parent: Parent,
    /// Shape.
    pub shape: RapierShape,
    /// Pose in the frame of the body.
    pub pose: Isometry3<f64>,
    /// Coefficient of friction; of two colliders the smaller one counts.
    pub friction: f64,
}

/// A free body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RapierObject {
    /// Pose of its frame, which lies in its centre of mass.
    pub pose: Isometry3<f64>,
    /// Mass [kg].
    pub mass: f64,
    /// Principal moments along the axes of the frame [kg m^2].
    pub inertia: Vector3<f64>,
}

/// Arguments of [`RapierWorld::new`](crate::RapierWorld::new).
#[derive(Clone, Debug)]
pub struct RapierStart<'a> {
    /// The robot.
    pub chain: &'a Chain,
    /// Joint positions [rad or m].
    pub position: JointVector,
    /// Free bodies.
    pub objects: Vec<RapierObject>,
    /// Colliders.
    pub colliders: Vec<RapierCollider>,
    /// Pairs of colliders that may touch, by their indices; all others pass through each other.
    pub pairs: Vec<[usize; 2]>,
    /// Gravity [m/s^2].
    pub gravity: Vector3<f64>,
    /// Softness of the contacts.
    pub softness: Softness,
}
