//! The physics engine [rapier](https://rapier.rs) as a world for the plant: the robot is a multibody in its joint coordinates,
//! floor and objects are rigid bodies, and contacts are soft constraints of one softness for all.
//!
//! [`RapierWorld`] knows neither messages nor scenarios; the plant translates.
//!
//! rapier integrates by a linearly implicit Euler rule of first order, and solves contacts by projected Gauss-Seidel with
//! warm starts. A contact's depth follows from its softness and the effective mass, not from a stiffness; friction has one
//! coefficient. docs/engines.md compares it with the plant's own engine.

mod multibody;
mod snapshot;
mod start;
mod world;

pub use start::{Parent, RapierCollider, RapierObject, RapierShape, RapierStart, Softness};
pub use world::{JointDrive, ObjectMotion, RapierContact, RapierWorld};
